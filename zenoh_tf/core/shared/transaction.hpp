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
ZTF_ALWAYS_INLINE bool SharedTree::try_read(int attempts, Body&& body) const {
  Patience patience;
  const auto may_try = [&] { return attempts-- > 0 && !patience.is_exhausted(); };
  return retry_while(may_try, [&]() __attribute__((always_inline)) {
    Attempt attempt(memory_, names_);
    const bool valid = body(MappedFrames(frames_, attempt), patience);
    if (attempt.is_unreadable) throw Unanswered{Unanswered::Reason::unreadable};
    if (valid) check_lease();
    return valid;
  });
}

template <class Guard>
ZTF_ALWAYS_INLINE Reader<Guard, MappedFrames> SharedTree::reader_of(const MappedFrames& frames,
                                                                    Guard& guard) const noexcept {
  return {frames, guard, max_depth_, ever_reparented_, ids_freed_};
}

template <class Body>
void SharedTree::read(ReadSet& reads, Body&& body) const {
  const bool is_read =
      try_read(kSharedAttempts, [&](const MappedFrames& frames, Patience& patience) {
        PatientGuard guard(frames_, reads, patience);
        Reader reader = reader_of(frames, guard);
        return body(reader) && guard.validate_all();
      });
  if (!is_read) throw Unanswered{Unanswered::Reason::busy};
}

template <class Result, class Body>
Result SharedTree::read_frame(FrameId id, Body&& body) const {
  Result result{};
  const bool is_read =
      try_read(kSharedAttempts, [&](const MappedFrames& frames, Patience& patience) {
        const Frame& frame = *frames.frame(id);
        const Version version = frame.version.read_begin([&] { return patience.wait(); });
        result = body(frames, frame, version);
        yield_point();
        return frame.version.current() == version;
      });
  if (!is_read) throw Unanswered{Unanswered::Reason::busy};
  return result;
}

}  // namespace ztf
