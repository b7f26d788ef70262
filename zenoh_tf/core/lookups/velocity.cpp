// Velocities from the history of poses.
//
// The averaging window is tf2's. It is as long as the averaging interval and centred at the time
// asked for. It is moved back if it would end after the latest common time, and cut off if it would
// begin before time zero.
#include "lookups/transaction.hpp"
#include "shared/transaction.hpp"

namespace ztf {

namespace {

// Both saturate instead of overflowing.
Stamp later(Stamp stamp, Stamp by) noexcept {
  return stamp > std::numeric_limits<Stamp>::max() - by ? std::numeric_limits<Stamp>::max()
                                                        : stamp + by;
}
Stamp earlier(Stamp stamp, Stamp by) noexcept {
  return stamp < kNoStamp + 1 + by ? kNoStamp + 1 : stamp - by;
}

// Computes the velocity. Returns false if the transaction must be retried, like Reader's functions.
template <class AnyReader>
bool measure(AnyReader& reader, const VelocityQuery& q, VelocityAnswer& a) {
  using Leg = VelocityAnswer::Leg;
  a = VelocityAnswer{};
  const auto lookup = [&](Leg leg, const Query& query, Answer& answer) {
    if (!reader.answer(query, answer)) return false;
    a.leg = leg;
    a.failure = answer.failure;
    return true;
  };
  Answer latest;
  if (!lookup(Leg::tracking, {Op::common_time, q.observation, q.tracking}, latest)) return false;
  if (a.failure.code != Code::ok) return true;

  const bool timeless = latest.stamp == kNoStamp;  // all links are static, so any time serves
  a.stamp = q.stamp != kNoStamp ? q.stamp : timeless ? 0 : latest.stamp;
  a.end = later(a.stamp, q.interval / 2);
  if (!timeless) a.end = std::min(a.end, latest.stamp);
  a.start = earlier(a.end, q.interval);
  if (a.end > 0) a.start = std::max(a.start, Stamp{0});

  struct Step {
    Leg leg;
    FrameId target, source;
    Stamp stamp;
  };
  const Step steps[] = {{Leg::tracking, q.observation, q.tracking, a.start},
                        {Leg::tracking, q.observation, q.tracking, a.end},
                        {Leg::tracking, q.observation, q.tracking, a.stamp},
                        {Leg::point, q.observation, q.point_frame, a.stamp},
                        {Leg::reference, q.reference, q.observation, a.stamp}};
  Pose poses[5];
  for (int i = 0; i < 5; ++i) {
    Answer answer;
    const auto [leg, target, source, stamp] = steps[i];
    if (!lookup(leg, query_at_time(target, source, stamp, q.max_gap), answer)) return false;
    if (a.failure.code != Code::ok) return true;
    a.gap = std::max(a.gap, answer.gap);
    poses[i] = answer.pose;
  }
  const auto& [start, end, body, X_observation_point, X_reference_observation] = poses;
  const Vec3 offset = rotate(X_observation_point, q.point.x, q.point.y, q.point.z);
  const Vec3 arm{X_observation_point.x - body.x + offset.x,
                 X_observation_point.y - body.y + offset.y,
                 X_observation_point.z - body.z + offset.z};
  const double seconds = static_cast<double>(span_ns(a.start, a.end)) * 1e-9;
  a.twist = rotate_twist(X_reference_observation,
                         shift_reference_point(twist_between(start, end, seconds), arm));
  return true;
}

}  // namespace

void lookup_velocity(const TreeState& tree, const VelocityQuery& query, VelocityAnswer& answer) {
  ReadSet reads;
  read(tree, reads, [&](auto& reader) { return measure(reader, query, answer); });
}

void SharedTree::lookup_velocity(const VelocityQuery& query, VelocityAnswer& answer) const {
  ReadSet reads;
  read(reads, [&](auto& reader) { return measure(reader, query, answer); });
}

}  // namespace ztf
