// The poses of up to four links are interpolated at once, which takes about as long as one.
#include "reads/compose.hpp"

#include "histories/four_samples.hpp"
#include "histories/gap.hpp"

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

// The slow path of finding gaps.
[[gnu::noinline]] Stamp longest_gap(std::span<const PathStep> steps) noexcept {
  Stamp longest = 0;
  for (const PathStep& step : steps)
    if (const Stamp interval = interpolated_ns(step.interval);
        interval > longest && is_gap(*step.frame, static_cast<double>(interval)))
      longest = interval;
  return longest;
}

ZTF_ALWAYS_INLINE Pose compose_group(std::span<const PathStep> steps, Stamp& gap) noexcept {
  const auto is_sample = [](const PathStep& step) {
    return step.interval.older == step.interval.newer;
  };
  if (std::all_of(steps.begin(), steps.end(), is_sample))
    return product(steps.size(),
                   [&](std::size_t i) { return steps[i].interval.older->pose.load(); });
  const auto step = [&](std::size_t i) -> const PathStep& {
    return steps[std::min(i, steps.size() - 1)];
  };
  Double4 spans{};
  const Pose4 poses =
      interpolate(step(0).interval, step(1).interval, step(2).interval, step(3).interval, spans);
  const Double4 rates{rate_for_gaps(*step(0).frame), rate_for_gaps(*step(1).frame),
                      rate_for_gaps(*step(2).frame), rate_for_gaps(*step(3).frame)};
  if (largest(spans * rates) > kSuspectPeriods) [[unlikely]]
    gap = std::max(gap, longest_gap(steps));
  return product(steps.size(), [&](std::size_t i) { return lane(poses, i); });
}

}  // namespace

ZTF_MULTIVERSION Stamp compose(std::span<const PathStep> steps, Pose& pose) noexcept {
  Stamp gap = 0;
  pose = compose_group(steps.first(std::min(kGroup, steps.size())), gap);
  for (std::size_t done = kGroup; done < steps.size(); done += kGroup)
    pose = compose_group(steps.subspan(done, std::min(kGroup, steps.size() - done)), gap) * pose;
  return gap;
}

}  // namespace ztf
