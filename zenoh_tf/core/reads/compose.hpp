// A step of a walk, and composing the poses along several steps.
//
// Thread safety: any reader may call compose() at any time. Its result is meaningful only if the
// steps' frames still have the steps' versions afterwards (reads/guards.hpp).
#pragma once

#include <span>

#include "histories/history.hpp"

namespace ztf {

// One link of a path towards the root, as it was read: the link's child frame, the version of that
// frame, and the samples that give the link's pose.
struct PathStep {
  const Frame* frame;
  Version version;
  // interval.time is the requested time. For a newest link (SelectLatest) it is the link's own
  // stamp, or kNoStamp if the link is static.
  SampleInterval interval;
};

// Sets X_parent_child, where child is the first step's frame and parent the parent of the last
// step's frame. Returns the longest gap that it was interpolated over (histories/gap.hpp), or 0.
// Requires at least one step.
Stamp compose(std::span<const PathStep> steps, Pose& pose) noexcept;

}  // namespace ztf
