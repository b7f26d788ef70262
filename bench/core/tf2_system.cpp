// The real tf2: its BufferCore, as installed. It knows names only, and one set at a time.
#include <console_bridge/console.h>
#include <geometry_msgs/TransformStamped.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>

#include <tuple>

#include "system.hpp"

namespace bench {

namespace {

class Tf2System final : public System {
 public:
  Tf2System(const Names& names, const Settings& settings)
      : names_(names),
        child_to_parent_(settings.count("child_to_parent") != 0),
        buffer_(ros::Duration(settings.number("cache_s"))) {
    // Silences the warning that two writers have set a link at the same nanosecond.
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_NONE);
  }

  bool has_transactions() const override { return false; }

  unsigned lookup(Read read, const Request* requests, unsigned count, Reply& last) override {
    unsigned found = 0;
    for (unsigned i = 0; i < count; ++i) {
      const Request& request = requests[i];
      const ros::Time time = read == Read::at ? to_time(request.time) : ros::Time(0);
      try {
        const auto m =
            buffer_.lookupTransform(names_[request.target], names_[request.source], time);
        const auto& t = m.transform.translation;
        const auto& q = m.transform.rotation;
        keep(t.x);
        if (i + 1 == count)
          last = {{t.x, t.y, t.z, q.x, q.y, q.z, q.w}, static_cast<Stamp>(m.header.stamp.toNSec())};
        ++found;
      } catch (const tf2::TransformException&) {  // counted by the caller
      }
    }
    return found;
  }

  unsigned write(FrameIndex first, unsigned links, Stamp stamp) override {
    static thread_local geometry_msgs::TransformStamped m;  // its strings keep their memory
    unsigned stored = 0;
    for (unsigned i = 0; i < links; ++i) {
      const FrameIndex link = first + (child_to_parent_ ? links - 1 - i : i);
      const auto& [x, y, z, qx, qy, qz, qw] = pose_at(link, stamp);
      m.header.frame_id = names_[link - 1];
      m.child_frame_id = names_[link];
      m.header.stamp = to_time(stamp);
      auto& t = m.transform.translation;
      auto& q = m.transform.rotation;
      std::tie(t.x, t.y, t.z) = std::tie(x, y, z);
      std::tie(q.x, q.y, q.z, q.w) = std::tie(qx, qy, qz, qw);
      stored += buffer_.setTransform(m, authority_);
    }
    return stored;
  }

 private:
  static ros::Time to_time(Stamp stamp) {
    return ros::Time().fromNSec(static_cast<std::uint64_t>(stamp));
  }

  const std::string authority_ = "bench";
  const Names& names_;
  const bool child_to_parent_;
  tf2::BufferCore buffer_;
};

}  // namespace

std::unique_ptr<System> make_tf2_system(const Names& names, const Settings& settings) {
  return std::make_unique<Tf2System>(names, settings);
}

}  // namespace bench
