// The locks of a commit's write set.
//
// Strict two-phase locking: all locks are taken before the first write and released after the last.
// A writer that waits while it holds locks takes them in ascending id, without duplicates. Writers
// therefore cannot deadlock.
//
// The linearization point is the instant from which all frames of the write set have kWriting set.
// It lies in begin_write(), or for a single frame in the constructor. No frame is unlocked before
// it, so a reader of the old state is ordered before the commit, a reader of the new state after
// it. begin_write() may come long after the locks are taken, but must precede the validation of the
// commit's read set.
//
// Thread safety: lives on the writer's stack.
#pragma once

#include <algorithm>

#include "modes/modes.hpp"

namespace ztf {

class WriteLocks {
 public:
  // Waits for the locks of these frames. For a single frame the same step begins the write, as its
  // readers wait hardly longer then; unless the plan is long (CommitPlan::is_long()). Requires that
  // the list outlives this object. Throws bad_alloc.
  WriteLocks(TreeState& tree, const FrameList& ascending, bool long_plan = false)
      : tree_(tree), frames_(ascending), readers_may_read_(long_plan || ascending.size() > 1) {
    // Allocates before the first lock, because a constructor that throws would unlock nothing.
    (void)locked_.reserve(ascending.size());
    lock_write_set(tree, ascending);
    for (const FrameId id : ascending) {
      SeqLock& word = tree.frames[id].version;
      locked_.push_back({id, readers_may_read_ ? word.lock_writer() : word.lock_and_begin_write()});
    }
  }
  ~WriteLocks() {
    if (locked_.size() != 0) release({});
  }
  WriteLocks(const WriteLocks&) = delete;
  WriteLocks& operator=(const WriteLocks&) = delete;

  // The locked frames, ascending.
  [[nodiscard]] const FrameList& frames() const noexcept { return frames_; }

  // The version that a frame had when it was locked; null if this commit does not hold it.
  [[nodiscard]] const Version* version_before(FrameId id) const noexcept {
    const auto at = std::lower_bound(locked_.begin(), locked_.end(), id,
                                     [](const ReadVersion& r, FrameId f) { return r.frame < f; });
    return at != locked_.end() && at->frame == id ? &at->version : nullptr;
  }

  // The version that a locked frame gets if it changes.
  [[nodiscard]] Version version_after(FrameId id) const noexcept {
    return next_version(*version_before(id));
  }

  // Makes readers of the frames wait. Must precede the first write and the validation of a read
  // set. Further calls do nothing. The sequentially consistent fence orders it before the unlocking
  // for all threads, so two readers cannot see two independent commits in opposite orders.
  void begin_write() noexcept {
    if (!readers_may_read_) return;
    yield_point();
    for (const ReadVersion& locked : locked_)
      tree_.frames[locked.frame].version.begin_write(locked.version);
    std::atomic_thread_fence(std::memory_order_seq_cst);
    readers_may_read_ = false;
  }

  // Unlocks all frames, and gives each the version `new_version_of(id, version before)`.
  template <class NewVersion>
  void release_each(NewVersion&& new_version_of) noexcept {
    for (const ReadVersion& locked : locked_)
      tree_.frames[locked.frame].version.unlock_changed(
          new_version_of(locked.frame, locked.version));
    unlock_write_set(tree_, {locked_.begin(), locked_.size()});
    locked_.clear();
  }

  // Unlocks all frames, and gives each a new version, which is `least` or later.
  void release_from(Version least) noexcept {
    release_each(
        [&](FrameId, Version before) noexcept { return std::max(next_version(before), least); });
  }

  // Unlocks all frames, and gives those in `changed` a new version. Requires that `changed` is a
  // subset of the locked frames, ascending.
  void release(const FrameList& changed) noexcept {
    const bool all = changed.size() == locked_.size();
    const FrameId* next = changed.begin();
    release_each([&](FrameId id, Version before) noexcept {
      if (!all && (next == changed.end() || *next != id)) return before;
      ++next;
      return next_version(before);
    });
  }

 private:
  TreeState& tree_;
  const FrameList& frames_;
  bool readers_may_read_;                // false once the write has begun
  SmallVector<ReadVersion, 16> locked_;  // the frames locked so far, with their old versions
};

}  // namespace ztf
