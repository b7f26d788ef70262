// Composing the links of a way.
//
// Thread safety: for any reader, as everything about samples (frame.hpp).
#pragma once

#include "history.hpp"

namespace ztf {

// A link of a way up, as read: the frame it leads up from, in which version,
// and which of the frame's samples it is.
struct PathStep {
  const Frame* frame;
  Version version;
  SampleInterval
      interval;  // newest links: of their own time, kNoStamp where static, good for all times
};

// Gives X_parent_child of that many links, one at least, from the child at
// steps[0] up to the parent of the last. Into a reference: a pose that is
// returned would be stored in parts and copied as a whole, and that stalls.
void compose(const PathStep* steps, std::size_t links, Pose& pose) noexcept;

}  // namespace ztf
