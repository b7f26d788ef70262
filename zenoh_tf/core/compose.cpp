// Composing the links of a way, four at a time: their interpolations are one, and their products
// two halves that do not wait for each other, as in a running product all would.
#include "compose.hpp"

#include "pose4.hpp"

namespace ztf {

namespace {

constexpr std::size_t kGroup = 4;

// From pose_of(0), the child's, up to the last.
template <class PoseOf>
ZTF_ALWAYS_INLINE Pose product(std::size_t links, PoseOf&& pose_of) noexcept {
  if (links == 1) return pose_of(0);
  const Pose lower = pose_of(1) * pose_of(0);
  if (links == 2) return lower;
  return (links == 3 ? pose_of(2) : pose_of(3) * pose_of(2)) * lower;
}

ZTF_ALWAYS_INLINE Pose product_of(const PathStep* steps, std::size_t links) noexcept {
  bool newest = true;
  for (std::size_t i = 0; i < links; ++i)
    newest &= steps[i].interval.older == steps[i].interval.newer;
  if (newest)
    return product(links, [&](std::size_t i) { return steps[i].interval.older->pose.load(); });
  const auto row = [&](std::size_t i) -> const SampleInterval& {
    return steps[std::min(i, links - 1)].interval;
  };
  const Pose4 poses = interpolate(row(0), row(1), row(2), row(3));
  if (links == 4) {
    const Pose4 pairs = product_of_pairs(poses);
    return lane(pairs, 2) * lane(pairs, 0);
  }
  return product(links, [&](std::size_t i) { return lane(poses, i); });
}

}  // namespace

ZTF_MULTIVERSION void compose(const PathStep* steps, std::size_t links, Pose& pose) noexcept {
  std::size_t done = std::min(kGroup, links);
  pose = product_of(steps, done);
  while (done < links) {
    const std::size_t n = std::min(kGroup, links - done);
    pose = product_of(steps + done, n) * pose;
    done += n;
  }
}

}  // namespace ztf
