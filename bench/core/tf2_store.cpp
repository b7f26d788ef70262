// The real tf2's store: its BufferCore, as installed. It has no ids that could be asked for a
// transform, and no transactions: what belongs together is set link by link.
#include <console_bridge/console.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>

#include <array>
#include <cmath>
#include <stdexcept>

#include "store.hpp"
#include "tf2_message.hpp"

namespace bench {

namespace {

class Tf2Store final : public Store {
 public:
  Tf2Store(const Forest& forest, const StoreOptions& options)
      : forest_(forest),
        reversed_(options.reversed),
        buffer_(ros::Duration().fromNSec(options.cache)) {
    // Two writers that set a link at the same nanosecond: it would tell the terminal.
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_NONE);
    set_all(forest, reversed_, [&](FrameIndex link) { set(link, kStart); });
  }

  std::string name() const override { return "tf2"; }
  bool can(Read kind) const override { return kind == Read::common; }

  bool read(unsigned, Read, FrameIndex target, FrameIndex source, Stamp& oldest) override try {
    const auto m =
        buffer_.lookupTransform(forest_.names[target], forest_.names[source], ros::Time(0));
    keep(m.transform.translation.x);
    oldest = static_cast<Stamp>(m.header.stamp.toNSec());
    return true;
  } catch (const tf2::TransformException&) {
    return false;
  }

  bool ask(Read, FrameIndex target, FrameIndex source, Reply& reply) override try {
    const auto m =
        buffer_.lookupTransform(forest_.names[target], forest_.names[source], ros::Time(0));
    const auto& t = m.transform.translation;
    const auto& q = m.transform.rotation;
    reply = {{t.x, t.y, t.z, q.x, q.y, q.z, q.w}, static_cast<Stamp>(m.header.stamp.toNSec())};
    return true;
  } catch (const tf2::TransformException&) {
    return false;
  }

  void set(FrameIndex link, Stamp stamp) override {
    geometry_msgs::TransformStamped m;
    if (!set_link(m, link, stamp)) throw std::runtime_error("tf2: not stored");
  }

  unsigned write(unsigned thread, FrameIndex top, unsigned links, Stamp stamp) override {
    unsigned stored = 0;
    for (unsigned i = 0; i < links; ++i)
      stored += set_link(own_[thread].message, reversed_ ? top + links - i : top + 1 + i, stamp);
    return stored;
  }

  double mean_newest(unsigned thread, FrameIndex top, unsigned links) override {
    double sum = 0;
    for (unsigned i = 0; i < links; ++i) {
      Stamp stamp;
      if (!read(thread, Read::common, top + i, top + i + 1, stamp)) return std::nan("");
      sum += static_cast<double>(stamp - kStart);
    }
    return sum / links;
  }

 private:
  bool set_link(geometry_msgs::TransformStamped& m, FrameIndex link, Stamp stamp) {
    const ztf::Pose& pose = pose_at(link, stamp);
    fill(m, forest_.names[forest_.parents[link]], forest_.names[link], stamp, pose);
    return buffer_.setTransform(m, authority_);
  }

  struct alignas(128) Own {
    geometry_msgs::TransformStamped message;
  };

  const std::string authority_ = "bench";
  const Forest& forest_;
  const bool reversed_;
  tf2::BufferCore buffer_;
  std::array<Own, kMaxThreads> own_;
};

}  // namespace

std::unique_ptr<Store> make_tf2_store(const Forest& forest, const StoreOptions& options) {
  return std::make_unique<Tf2Store>(forest, options);
}

}  // namespace bench
