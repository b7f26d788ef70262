// Composing the links of a way: in two halves that do not wait for each other,
// for the running product is a long chain of dependent operations.
#include "compose.hpp"

namespace ztf {

namespace {

Pose pose_of(const Step& step, Stamp stamp) noexcept {
  return step.slot == Place::kNewest ? step.frame->latest_pose.load()
                                     : pose_between(*step.frame, step.slot, stamp);
}

Pose product(const Step* step, const Step* end, Stamp stamp) noexcept {
  Pose pose = pose_of(*step, stamp);
  while (++step != end) pose = pose_of(*step, stamp) * pose;
  return pose;
}

}  // namespace

void compose(const Step* steps, std::size_t links, Stamp stamp, Pose& pose) noexcept {
  const std::size_t half = links - links / 2;
  pose = product(steps, steps + half, stamp);
  if (links > 1) pose = product(steps + half, steps + links, stamp) * pose;
}

}  // namespace ztf
