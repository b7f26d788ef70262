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
        pose_at_(settings.number("rad_per_ms")),
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
    unsigned stored = 0;
    for (unsigned i = 0; i < links; ++i) {
      const FrameIndex link = first + (child_to_parent_ ? links - 1 - i : i);
      stored += set(names_[link - 1], names_[link], stamp, pose_at_(link, stamp));
    }
    return stored;
  }

  void grasp(Stamp stamp) override {
    set(names_.front(), kGrasped, stamp, pose_at_(0, stamp));
    set(names_.back(), kGrasped, stamp + 1, pose_at_(0, stamp));
  }

 private:
  bool set(const std::string& parent, const std::string& child, Stamp stamp,
           const ztf::Pose& pose) {
    static thread_local geometry_msgs::TransformStamped m;  // its strings keep their memory
    const auto& [x, y, z, qx, qy, qz, qw] = pose;
    m.header.frame_id = parent;
    m.child_frame_id = child;
    m.header.stamp = to_time(stamp);
    auto& t = m.transform.translation;
    auto& q = m.transform.rotation;
    std::tie(t.x, t.y, t.z) = std::tie(x, y, z);
    std::tie(q.x, q.y, q.z, q.w) = std::tie(qx, qy, qz, qw);
    return buffer_.setTransform(m, authority_);
  }

  static ros::Time to_time(Stamp stamp) {
    return ros::Time().fromNSec(static_cast<std::uint64_t>(stamp));
  }

  const std::string authority_ = "bench";
  const Names& names_;
  const bool child_to_parent_;
  const Motion pose_at_;
  tf2::BufferCore buffer_;
};

}  // namespace

std::unique_ptr<System> make_tf2_system(const Names& names, const Settings& settings) {
  return std::make_unique<Tf2System>(names, settings);
}

}  // namespace bench
