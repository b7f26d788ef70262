// Composing the links of a way, four at a time: their interpolations are one, and their products
// two halves that do not wait for each other, as in a running product all would.
#include "compose.hpp"

#include "quad.hpp"

namespace ztf {

namespace {

constexpr std::size_t kGroup = 4;

// From pose_of(0), the child's, up to the last.
template <class PoseOf>
ZTF_HOT Pose product(std::size_t links, PoseOf&& pose_of) noexcept {
  if (links == 1) return pose_of(0);
  const Pose lower = pose_of(1) * pose_of(0);
  if (links == 2) return lower;
  return (links == 3 ? pose_of(2) : pose_of(3) * pose_of(2)) * lower;
}

ZTF_HOT Pose product_at(const Step* steps, std::size_t links, Stamp stamp) noexcept {
  bool newest = true;
  for (std::size_t i = 0; i < links; ++i) newest &= steps[i].slot == Place::kNewest;
  if (newest)
    return product(links, [&](std::size_t i) { return steps[i].frame->latest_pose.load(); });
  Between rows[kGroup];
  for (std::size_t i = 0; i < kGroup; ++i) {
    const Step& step = steps[std::min(i, links - 1)];
    rows[i] = between(*step.frame, step.slot, stamp);
  }
  const PoseQuad poses = interpolate(rows);
  return product(links, [&](std::size_t i) { return unpacked(poses, i); });
}

}  // namespace

ZTF_CLONES void compose(const Step* steps, std::size_t links, Stamp stamp, Pose& pose) noexcept {
  std::size_t done = std::min(kGroup, links);
  pose = product_at(steps, done, stamp);
  while (done < links) {
    const std::size_t n = std::min(kGroup, links - done);
    pose = product_at(steps + done, n, stamp) * pose;
    done += n;
  }
}

}  // namespace ztf
