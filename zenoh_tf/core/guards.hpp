// The concurrency controls, as seen by a reader.
//
// A guard spans one read-only transaction. enter() comes before a frame's data
// is read and gives the frame's version, or false: give up and start over with
// fresh state. rest() comes after the data was read and names what the answer
// rests on; false: it has changed already. valid() says at the end whether all
// that the answer rests on was true at one instant.
//
// Why `optimistic` is strictly serializable: between the last reading and the
// first check there is an instant at which every frame named had the version
// that was read, since each had it before and still has it after. That instant
// is the transaction's place in the order. Between holding readers off and
// unlocking, a writer has a sequentially consistent fence or exchange, and checks
// load likewise, so two readers cannot see two independent writes in opposite
// orders (docs/concurrency.md).
#pragma once

#include <algorithm>
#include <utility>

#include "compose.hpp"
#include "small_vector.hpp"

namespace ztf {

enum class Concurrency : std::uint8_t { optimistic, two_phase, giant };

// A frame and the version in which it was read.
struct ReadVersion {
  FrameId frame;
  Version version;
};
using ReadSet = SmallVector<ReadVersion, 64>;
using FrameList = SmallVector<FrameId, 16>;

// For a transaction of one walk: checked as soon as it is over. Where a walk
// decides that another is needed, it is checked after that one, so that the
// times over which both were true overlap.
class WalkGuard {
 public:
  ZTF_ALWAYS_INLINE bool read_version(const Frame& frame, Version& version) const {
    version = frame.version.read_begin();
    return true;
  }
  ZTF_ALWAYS_INLINE bool validate(const PathStep* steps, std::size_t n) const noexcept {
    yield_point();
    Version differ = 0;
    for (const PathStep* step = steps; step != steps + n; ++step)
      differ |= step->frame->version.load() ^ step->version;
    return differ == 0;
  }
};

// What the guards of longer transactions have in common: the list of all reads.
class RecordingGuard {
 public:
  RecordingGuard(const Frame* frames, ReadSet& reads) noexcept : frames_(frames), reads_(reads) {
    reads_.clear();
  }
  bool validate(const PathStep* steps, std::size_t n) {
    ReadVersion* const reads = reads_.append(n);
    for (std::size_t i = 0; i < n; ++i) reads[i] = {id_of(*steps[i].frame), steps[i].version};
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
      if (frames_[read.frame].version.load() != read.version) return false;
    return true;
  }
};

// Where optimism has failed too often: owns the frames that the last attempt
// needed, as a writer does that does not write. Where an attempt needs another frame it reads
// on, unprotected, to learn what else it needs, and starts over with more. Each
// attempt adds a frame at least, and what is locked stands still, so it ends.
class LockingGuard : public RecordingGuard {
 public:
  LockingGuard(Frame* frames, ReadSet& reads, SmallVector<FrameId, 64>& wanted)
      : RecordingGuard(frames, reads), frames_(frames), wanted_(wanted) {
    std::sort(wanted_.begin(), wanted_.end());
    wanted_.set_size(
        static_cast<std::size_t>(std::unique(wanted_.begin(), wanted_.end()) - wanted_.begin()));
    (void)held_.reserve(
        wanted_.size());  // before the first lock: a constructor that fails unlocks nothing
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
      complete_ = false;
      wanted_.push_back(id);
    }
    return true;
  }
  [[nodiscard]] bool validate_all() const { return complete_; }

 private:
  Frame* frames_;
  SmallVector<FrameId, 64>& wanted_;
  SmallVector<ReadVersion, 64> held_;
  bool complete_ = true;
};

// Two-phase locking: shared locks, held to the end. A reader may wait for a
// writer while it holds locks, because writers never wait while they hold any.
// A frame that a starving writer wants is left alone for some attempts, unless
// nothing else would ever be read.
class SharedGuard : public RecordingGuard {
 public:
  SharedGuard(Frame* frames, ReadSet& reads, bool heed_wanted)
      : RecordingGuard(frames, reads), frames_(frames), heed_wanted_(heed_wanted) {}
  ~SharedGuard() {
    for (const FrameId id : held_) frames_[id].shared.unlock_shared();
  }
  SharedGuard(const SharedGuard&) = delete;
  SharedGuard& operator=(const SharedGuard&) = delete;

  bool read_version(const Frame& frame, Version& version) {
    const FrameId id = id_of(frame);
    (void)held_.reserve(1);  // what is locked must be noted
    Backoff backoff;
    for (;;) {
      switch (frames_[id].shared.try_lock_shared(heed_wanted_)) {
        case SharedLock::Shared::taken:
          held_.push_back(id);
          yield_point();
          version = frames_[id].version.load();
          return true;
        case SharedLock::Shared::wanted:
          return false;
        case SharedLock::Shared::writer:
          backoff.wait();
      }
    }
  }

 private:
  Frame* frames_;
  SmallVector<FrameId, 64> held_;
  const bool heed_wanted_;
};

// For who holds the tree's one mutex.
class GiantGuard : public RecordingGuard {
 public:
  using RecordingGuard::RecordingGuard;
  bool read_version(const Frame& frame, Version& version) const {
    version = frame.version.load();
    return true;
  }
};

// Without protection: for links that are consistent each by itself.
class NoGuard {
 public:
  bool read_version(const Frame&, Version& version) const {
    version = 0;
    return true;
  }
  bool validate(const PathStep*, std::size_t) const { return true; }
};

}  // namespace ztf
