// The real tf2's side: its BufferCore, as installed.
#include <tf2/buffer_core.h>

#include <array>
#include <stdexcept>

#include "side.hpp"
#include "tf2_message.hpp"

namespace bench {

namespace {

geometry_msgs::TransformStamped message(const Link& link, Stamp stamp, const ztf::Pose& pose) {
  geometry_msgs::TransformStamped m;
  fill(m, link.parent, link.child, stamp, pose);
  return m;
}

class Tf2Side final : public Side {
 public:
  Tf2Side() : buffer_(ros::Duration().fromNSec(kCache)) {
    const std::vector<Link> all = links();
    for (int k = 0; k < kSamples; ++k) {
      for (std::size_t i = 0; i < all.size(); ++i)
        set(message(all[i], kStart + all[i].offset + k * kPeriod, pose_of(i, k)));
      for (unsigned t = 0; t < kMaxThreads; ++t)
        set(message(link_to_set(t), kStart + k * kPeriod, pose_of(t, k)));
    }
    next_.fill(kSamples);
    for (const Stamp stamp : times()) times_.push_back(time_of(stamp));
  }

  std::string name() const override { return "tf2"; }

  Reply ask(const std::string& target, const std::string& source,
            std::optional<Stamp> time) override {
    const auto m = buffer_.lookupTransform(target, source, time ? time_of(*time) : ros::Time(0));
    const auto& t = m.transform.translation;
    const auto& q = m.transform.rotation;
    return {{t.x, t.y, t.z, q.x, q.y, q.z, q.w}, static_cast<Stamp>(m.header.stamp.toNSec())};
  }

  // tf2 has no ids: every call resolves the names.
  void run(const Case& what, std::size_t calls, unsigned thread) override {
    switch (what.kind) {
      case Kind::set: {
        auto m = message(link_to_set(thread), 0, pose_of(thread, 0));
        for (std::size_t i = 0; i < calls; ++i) {
          m.header.stamp = time_of(kStart + next_[thread]++ * kPeriod);
          set(m);
        }
        break;
      }
      case Kind::at_ids:
        for (std::size_t i = 0; i < calls; ++i)
          keep(buffer_.lookupTransform(what.target, what.source, times_[(i + thread * 97) % kTimes])
                   .transform.translation.x);
        break;
      default:
        for (std::size_t i = 0; i < calls; ++i)
          keep(buffer_.lookupTransform(what.target, what.source, ros::Time(0))
                   .transform.translation.x);
    }
  }

 private:
  void set(const geometry_msgs::TransformStamped& m) {
    if (!buffer_.setTransform(m, authority_)) throw std::runtime_error("tf2: not stored");
  }

  const std::string authority_ = "bench";
  tf2::BufferCore buffer_;
  std::array<Stamp, kMaxThreads> next_;
  std::vector<ros::Time> times_;
};

}  // namespace

std::unique_ptr<Side> make_tf2_side() { return std::make_unique<Tf2Side>(); }

}  // namespace bench
