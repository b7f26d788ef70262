// Read-only transactions of a shared tree. Included only by the files that implement its reads.
//
// Thread safety: any thread, like the tree's public functions.
#pragma once

#include "base/retries.hpp"
#include "reads/any_tree.hpp"
#include "reads/reader.hpp"
#include "shared/shared_tree.hpp"

namespace ztf {

// How often a read is tried. Each attempt may wait, but all of them together not longer than
// Patience allows.
constexpr int kSharedAttempts = 64;

template <class Body>
void SharedTree::read(ReadSet& reads, Body&& body) const {
  Patience patience;
  for (int i = 0; i < kSharedAttempts && !patience.is_exhausted(); ++i) {
    Attempt attempt(memory_, names_);
    PatientGuard guard(frames_, reads, patience);
    Reader reader(MappedFrames(frames_, attempt), guard, max_depth_, ever_reparented_, ids_freed_);
    const bool valid = body(reader) && guard.validate_all();
    if (attempt.is_unreadable) throw Unanswered{Unanswered::Reason::unreadable};
    if (valid) return check_lease();
    count_retry();
  }
  throw Unanswered{Unanswered::Reason::busy};
}

template <class Body>
auto SharedTree::read_frame(FrameId id, Body&& body) const {
  Patience patience;
  for (int i = 0; i < kSharedAttempts && !patience.is_exhausted(); ++i) {
    Attempt attempt(memory_, names_);
    const MappedFrames frames(frames_, attempt);
    const Frame& frame = *frames.frame(id);
    const Version version = frame.version.read_begin([&] { return patience.wait(); });
    const auto result = body(frames, frame, version);
    yield_point();
    if (attempt.is_unreadable) throw Unanswered{Unanswered::Reason::unreadable};
    if (frame.version.current() == version) {
      check_lease();
      return result;
    }
    count_retry();
  }
  throw Unanswered{Unanswered::Reason::busy};
}

}  // namespace ztf
