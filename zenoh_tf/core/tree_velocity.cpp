// Velocities from the history of poses.
//
// The window is tf2's: as long as the averaging interval, its middle at the time
// asked for, moved back where it would end after the latest common time, and cut
// off where it would begin before time zero.
#include "tree_read.hpp"

namespace ztf {

namespace {

// No overflow at the ends of time: what lies beyond them has no data anyhow.
Stamp later(Stamp stamp, Stamp by) noexcept {
  return stamp > std::numeric_limits<Stamp>::max() - by ? std::numeric_limits<Stamp>::max()
                                                        : stamp + by;
}
Stamp earlier(Stamp stamp, Stamp by) noexcept {
  return stamp < kNoStamp + 1 + by ? kNoStamp + 1 : stamp - by;
}

// False to start over, as everything of a Reader.
template <class Guard>
bool measure(Reader<Guard>& reader, const VelocityQuery& q, VelocityAnswer& a) {
  using Leg = VelocityAnswer::Leg;
  a = VelocityAnswer{};
  const auto ask = [&](Leg leg, const Query& query, Answer& answer) {
    if (!reader.answer(query, answer)) return false;
    a.leg = leg;
    a.failure = answer.failure;
    return true;
  };
  Answer latest;
  if (!ask(Leg::tracking, {Op::common_time, q.observation, q.tracking}, latest)) return false;
  if (a.failure.code != Code::ok) return true;

  const bool timeless = latest.stamp == kNoStamp;  // static links only: any time serves
  a.stamp = q.stamp != kNoStamp ? q.stamp : timeless ? 0 : latest.stamp;
  a.end = later(a.stamp, q.interval / 2);
  if (!timeless) a.end = std::min(a.end, latest.stamp);
  a.start = earlier(a.end, q.interval);
  if (a.end > 0) a.start = std::max(a.start, Stamp{0});

  struct Wanted {
    Leg leg;
    FrameId target, source;
    Stamp stamp;
  };
  const Wanted wanted[] = {{Leg::tracking, q.observation, q.tracking, a.start},
                           {Leg::tracking, q.observation, q.tracking, a.end},
                           {Leg::tracking, q.observation, q.tracking, a.stamp},
                           {Leg::point, q.observation, q.point_frame, a.stamp},
                           {Leg::reference, q.reference, q.observation, a.stamp}};
  Pose poses[5];
  for (int i = 0; i < 5; ++i) {
    Answer answer;
    const auto [leg, target, source, stamp] = wanted[i];
    if (!ask(leg, {Op::at, target, source, stamp}, answer)) return false;
    if (a.failure.code != Code::ok) return true;
    poses[i] = answer.pose;
  }
  const auto& [start, end, body, X_observation_point, X_reference_observation] = poses;
  const Vec3 to = rotate(X_observation_point, q.point.x, q.point.y, q.point.z);
  const Vec3 arm{X_observation_point.x - body.x + to.x, X_observation_point.y - body.y + to.y,
                 X_observation_point.z - body.z + to.z};
  const double seconds = static_cast<double>(span_ns(a.start, a.end)) * 1e-9;
  a.twist = rotate_twist(X_reference_observation,
                         shift_reference_point(twist_between(start, end, seconds), arm));
  return true;
}

}  // namespace

void Tree::lookup_velocity(const VelocityQuery& query, VelocityAnswer& answer) const {
  ReadSet reads;
  read(reads, [&](auto& reader) { return measure(reader, query, answer); });
}

}  // namespace ztf
