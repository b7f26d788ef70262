// Guards: how a reader makes sure that what it reads is the tree's state at one instant.
//
// A guard spans one read-only transaction. The reader calls three functions:
//   read_version(frame, version)  before it reads a frame. False: retry with fresh state.
//   validate(steps)               after it has read the steps' frames, for those that its answer
//                                 depends on. False: a frame has changed, so retry.
//   validate_all()                at the end. False: retry.
// There are two kinds of guards. With WalkGuard, validate() compares the versions at once, and
// there is no validate_all(). With a RecordingGuard, validate() only records the steps, and
// validate_all() decides: it is true if everything recorded was the tree's state at one instant.
// Here are those of mode `optimistic`; modes/ has the others.
//
// Thread safety: a guard belongs to one thread; any number of guards may exist at a time.
// Invariant (strict serializability of the optimistic guards): between the last read and the first
// validation there is an instant at which every frame of the read set had the version that was
// read. That instant is the transaction's linearization point. A writer has a sequentially
// consistent fence or compare-and-swap before it unlocks, and versions are loaded likewise, so two
// readers cannot see two independent commits in opposite orders (docs/explanation/concurrency.md).
#pragma once

#include <algorithm>
#include <span>
#include <utility>

#include "base/small_vector.hpp"
#include "reads/compose.hpp"

namespace ztf {

// A frame and the version in which it was read.
struct ReadVersion {
  FrameId frame;
  Version version;
};
using ReadSet = SmallVector<ReadVersion, 64>;
using FrameList = SmallVector<FrameId, 16>;

// The optimistic guard of a transaction that is one walk. It keeps no read set: validate() compares
// the versions at once. A reader may nest a second walk in the first; it validates the inner walk
// first, the outer last, so both were current at one instant.
class WalkGuard {
 public:
  ZTF_ALWAYS_INLINE bool read_version(const Frame& frame, Version& version) const {
    version = frame.version.read_begin();
    return true;
  }
  ZTF_ALWAYS_INLINE bool validate(std::span<const PathStep> steps) const noexcept {
    yield_point();
    for (const PathStep& step : steps)
      if (step.frame->version.current() != step.version) return false;
    return true;
  }
};

// The base of the guards for longer transactions. validate() compares nothing: it records the steps
// in the read set, and validate_all() compares them. The base's validate_all() is true: it serves
// guards whose locks keep the frames unchanged.
class RecordingGuard {
 public:
  RecordingGuard(const Frame* frames, ReadSet& reads) noexcept : frames_(frames), reads_(reads) {
    reads_.clear();
  }
  // Records the steps. Always true.
  bool validate(std::span<const PathStep> steps) {
    ReadVersion* const reads = reads_.append(steps.size());
    for (std::size_t i = 0; i < steps.size(); ++i)
      reads[i] = {id_of(*steps[i].frame), steps[i].version};
    return true;
  }
  [[nodiscard]] bool validate_all() const { return true; }

 protected:
  [[nodiscard]] FrameId id_of(const Frame& frame) const noexcept {
    return static_cast<FrameId>(&frame - frames_);
  }
  const Frame* const frames_;
  ReadSet& reads_;
};

// Reads without locks and validates the whole read set at the end.
class OptimisticGuard : public RecordingGuard {
 public:
  using RecordingGuard::RecordingGuard;
  bool read_version(const Frame& frame, Version& version) const {
    version = frame.version.read_begin();
    return true;
  }
  [[nodiscard]] bool validate_all() const {
    yield_point();
    for (const ReadVersion& read : reads_)
      if (frames_[read.frame].version.current() != read.version) return false;
    return true;
  }
};

// For a transaction whose optimistic attempts have failed too often. It holds the writer locks of
// the frames in `wanted`, so that they cannot change. If the attempt needs another frame, it reads
// that one unprotected, adds it to `wanted`, and fails in validate_all(). Each failed attempt adds
// at least one frame, so the retries end.
class LockingGuard : public RecordingGuard {
 public:
  LockingGuard(Frame* frames, ReadSet& reads, SmallVector<FrameId, 64>& wanted)
      : RecordingGuard(frames, reads), wanted_(wanted) {
    std::sort(wanted_.begin(), wanted_.end());
    wanted_.set_size(
        static_cast<std::size_t>(std::unique(wanted_.begin(), wanted_.end()) - wanted_.begin()));
    // Allocates before the first lock, because a constructor that throws would unlock nothing.
    (void)held_.reserve(wanted_.size());
    for (const FrameId id : wanted_) held_.push_back({id, frames_[id].version.lock_writer()});
  }
  ~LockingGuard() {
    for (const ReadVersion& held : held_)
      frames_[held.frame].version.unlock_unchanged(held.version);
  }
  LockingGuard(const LockingGuard&) = delete;
  LockingGuard& operator=(const LockingGuard&) = delete;

  bool read_version(const Frame& frame, Version& version) {
    const FrameId id = id_of(frame);
    const auto at = std::lower_bound(held_.begin(), held_.end(), id,
                                     [](const ReadVersion& r, FrameId f) { return r.frame < f; });
    if (at != held_.end() && at->frame == id) {
      version = at->version;
    } else {
      version = 0;
      all_locked_ = false;
      wanted_.push_back(id);
    }
    return true;
  }
  [[nodiscard]] bool validate_all() const { return all_locked_; }

 private:
  SmallVector<FrameId, 64>& wanted_;
  SmallVector<ReadVersion, 64> held_;
  bool all_locked_ = true;
};

}  // namespace ztf
