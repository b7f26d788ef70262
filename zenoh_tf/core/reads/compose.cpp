// The poses of up to four links are interpolated at once, which takes about as long as one.
#include "reads/compose.hpp"

#include "histories/four_samples.hpp"

namespace ztf {

namespace {

constexpr std::size_t kGroup = 4;

// Returns the product of one to four poses, the first on the right. The products of two pairs do
// not wait for each other. get_pose(i) returns pose i.
template <class GetPose>
ZTF_ALWAYS_INLINE Pose product(std::size_t links, GetPose&& get_pose) noexcept {
  if (links == 1) return get_pose(0);
  const Pose first = get_pose(1) * get_pose(0);
  if (links == 2) return first;
  return (links == 3 ? get_pose(2) : get_pose(3) * get_pose(2)) * first;
}

ZTF_ALWAYS_INLINE Pose compose_group(std::span<const PathStep> steps) noexcept {
  const auto is_sample = [](const PathStep& step) {
    return step.interval.older == step.interval.newer;
  };
  if (std::all_of(steps.begin(), steps.end(), is_sample))
    return product(steps.size(),
                   [&](std::size_t i) { return steps[i].interval.older->pose.load(); });
  const auto interval = [&](std::size_t i) -> const SampleInterval& {
    return steps[std::min(i, steps.size() - 1)].interval;
  };
  const Pose4 poses = interpolate(interval(0), interval(1), interval(2), interval(3));
  return product(steps.size(), [&](std::size_t i) { return lane(poses, i); });
}

}  // namespace

ZTF_MULTIVERSION void compose(std::span<const PathStep> steps, Pose& pose) noexcept {
  pose = compose_group(steps.first(std::min(kGroup, steps.size())));
  for (std::size_t done = kGroup; done < steps.size(); done += kGroup)
    pose = compose_group(steps.subspan(done, std::min(kGroup, steps.size() - done))) * pose;
}

}  // namespace ztf
