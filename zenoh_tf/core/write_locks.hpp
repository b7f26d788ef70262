// The locks of a commit's write set, under each concurrency control.
//
// Strict two-phase locking: all locks are taken before the first write and released after the last.
// Frames are locked in ascending id, without duplicates. That is the one order in which writers
// wait while they hold locks, so they cannot deadlock.
// The linearization point is in begin_write(), which makes readers of all frames wait before the
// first frame is unlocked. A reader of the old state is ordered before the commit, a reader of the
// new state after it. begin_write() may come long after the locks are taken, but must precede the
// validation of the commit's read set.
//
// Thread safety: lives on the writer's stack.
#pragma once

#include <chrono>
#include <random>
#include <thread>

#include "retries.hpp"
#include "tree.hpp"

namespace ztf {

class WriteLocks {
 public:
  // Waits for the locks of these frames. A single frame is locked and begin_write() done in one
  // step: its readers hardly lose time by it. The list must outlive this.
  WriteLocks(Tree& tree, const FrameList& ascending)
      : tree_(tree), frames_(ascending), readers_may_read_(ascending.size() > 1) {
    // Before the first lock: this may throw, and a constructor that throws unlocks nothing.
    (void)locked_.reserve(ascending.size());
    if (tree.options_.concurrency == Concurrency::optimistic) {
      lock_versions(ascending);
      return;
    }
    if (tree.options_.concurrency == Concurrency::two_phase) lock_shared_words(ascending);
    // Other writers are excluded already. A reader may hold one frame (SeqLock::read_consistent).
    for (const FrameId id : ascending) {
      SeqLock& word = tree.frames_[id].version;
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

  // Makes readers of the frames wait. Must precede the first write and the validation of a read
  // set. May be called again. The sequentially consistent fence orders it before the unlocking for
  // all threads: two readers cannot see two independent commits in opposite orders.
  void begin_write() noexcept {
    if (!readers_may_read_) return;
    yield_point();
    for (const ReadVersion& locked : locked_)
      tree_.frames_[locked.frame].version.begin_write(locked.version);
    std::atomic_thread_fence(std::memory_order_seq_cst);
    readers_may_read_ = false;
  }

  // Unlocks all frames, and gives those in `changed` a new version. `changed` must be ascending.
  void release(const FrameList& changed) noexcept {
    const bool all = changed.size() == locked_.size();
    const FrameId* next = changed.begin();
    for (const ReadVersion& locked : locked_) {
      SeqLock& word = tree_.frames_[locked.frame].version;
      if (all || (next != changed.end() && *next == locked.frame)) {
        word.unlock_changed(locked.version);
        ++next;
      } else {
        word.unlock_unchanged(locked.version);
      }
    }
    if (tree_.options_.concurrency == Concurrency::two_phase)
      for (const ReadVersion& locked : locked_) tree_.frames_[locked.frame].shared.unlock();
    locked_.clear();
  }

 private:
  // Takes the locks one by one. After a long wait it releases all locks and starts over, so that
  // other writers need not wait for a writer that waits: at most 16 times, and only while it holds
  // few locks.
  void lock_versions(const FrameList& ids) {
    Backoff backoff;
    for (int naps = 0; locked_.size() < ids.size();) {
      const FrameId id = ids[locked_.size()];
      SeqLock& word = tree_.frames_[id].version;
      Version before;
      if (readers_may_read_ ? word.try_lock_writer(before)
                            : word.try_lock_and_begin_write(before)) {
        locked_.push_back({id, before});
      } else if (!backoff.spin()) {
        if (++naps <= kMaxRestarts && locked_.size() <= kFewLocks) release({});
        count_retry();
        backoff.nap();
      }
    }
  }

  // Two-phase locking: takes all locks or none, and tries again after a random pause, so that it
  // never waits while it holds a lock. After 16 attempts it asks new readers to stay away.
  void lock_shared_words(const FrameList& ids) {
    for (int attempt = 0;; ++attempt) {
      std::size_t taken = 0;
      while (taken < ids.size() && tree_.frames_[ids[taken]].shared.try_lock()) ++taken;
      if (taken == ids.size()) break;
      while (taken > 0) tree_.frames_[ids[--taken]].shared.unlock();
      if (attempt >= kMaxRestarts)
        for (const FrameId id : ids) tree_.frames_[id].shared.want();
      count_retry();
      pause(attempt);
    }
    yield_point();
  }

  static void pause(int attempt) {
    thread_local std::minstd_rand random(
        static_cast<unsigned>(std::hash<std::thread::id>{}(std::this_thread::get_id())));
    if (attempt < 32)
      for (auto spins = random() % (16u << std::min(attempt, 5)); spins > 0; --spins) pause_cpu();
    else
      std::this_thread::sleep_for(std::chrono::microseconds(1 + random() % 50));
  }

  static constexpr int kMaxRestarts = 16;
  static constexpr std::size_t kFewLocks = 64;

  Tree& tree_;
  const FrameList& frames_;
  bool readers_may_read_;                // false once begin_write() has been called
  SmallVector<ReadVersion, 16> locked_;  // the frames locked so far, with their old versions
};

}  // namespace ztf
