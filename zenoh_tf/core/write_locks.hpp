// The locks of a commit's write set, under each concurrency control.
//
// Thread safety: lives on the writer's stack.
// Two phases: all locks are taken before the first write and released after
// the last. Ids come in ascending order without duplicates, which is the one
// order in which frames are waited for, so waiting writers cannot form a circle.
// Readers are held off from all frames before the first is released, and that is
// the commit's turn: who has read one of its frames as it was, comes before it; who
// has read one as it has become, after. It may be long after the locks were taken,
// but must come before a commit checks what it has read of others.
#pragma once

#include <chrono>
#include <random>
#include <thread>

#include "retries.hpp"
#include "tree.hpp"

namespace ztf {

class WriteLocks {
 public:
  // One frame is locked in one step, which holds readers off at once: it is as good as no time.
  WriteLocks(Tree& tree, const FrameList& ascending)
      : tree_(tree), readers_may_read_(ascending.size() > 1) {
    // Before the first lock: nothing can fail once there is something to be unlocked.
    (void)locked_.reserve(ascending.size());
    if (tree.options_.concurrency == Concurrency::optimistic) {
      lock_versions(ascending);
      return;
    }
    if (tree.options_.concurrency == Concurrency::two_phase) lock_shared_words(ascending);
    // Other writers are excluded already. A reader may hold one frame (SeqLock::read_consistent).
    for (const FrameId id : ascending) {
      SeqLock& word = tree.frames_[id].version;
      locked_.push_back({id, readers_may_read_ ? word.lock_writer() : word.lock()});
    }
  }
  ~WriteLocks() {
    if (locked_.size() != 0) release({});
  }
  WriteLocks(const WriteLocks&) = delete;
  WriteLocks& operator=(const WriteLocks&) = delete;

  // The version before, if this commit holds the frame.
  [[nodiscard]] const Version* version_before(FrameId id) const noexcept {
    const auto at = std::lower_bound(locked_.begin(), locked_.end(), id,
                                     [](const ReadVersion& r, FrameId f) { return r.frame < f; });
    return at != locked_.end() && at->frame == id ? &at->version : nullptr;
  }

  // Before the first write, and before a check of what was read of others. The fence puts all of it
  // before the unlocking for everyone: two readers cannot see two independent commits in opposite
  // orders.
  void begin_write() noexcept {
    if (!readers_may_read_) return;
    yield_point();
    for (const ReadVersion& locked : locked_)
      tree_.frames_[locked.frame].version.begin_write(locked.version);
    std::atomic_thread_fence(std::memory_order_seq_cst);
    readers_may_read_ = false;
  }

  // After the last write. The frames that have changed ascend, too.
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
  // Who has to wait for long lets go of what it holds, so that nobody waits for one who waits, and
  // begins again; but not for ever, and not where that is much.
  void lock_versions(const FrameList& ids) {
    Backoff backoff;
    for (int naps = 0; locked_.size() < ids.size();) {
      const FrameId id = ids[locked_.size()];
      SeqLock& word = tree_.frames_[id].version;
      Version before;
      if (readers_may_read_ ? word.try_lock_writer(before) : word.try_lock(before)) {
        locked_.push_back({id, before});
      } else if (!backoff.spin()) {
        if (++naps <= kPoliteAttempts && locked_.size() <= kFew) release({});
        count_retry();
        backoff.nap();
      }
    }
  }

  // No waiting while holding: all or nothing, and again after a jittered pause.
  // Who fails for long asks new readers to stay away from its frames.
  void lock_shared_words(const FrameList& ids) {
    for (int attempt = 0;; ++attempt) {
      std::size_t taken = 0;
      while (taken < ids.size() && tree_.frames_[ids[taken]].shared.try_lock()) ++taken;
      if (taken == ids.size()) break;
      while (taken > 0) tree_.frames_[ids[--taken]].shared.unlock();
      if (attempt >= kPoliteAttempts)
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
      for (auto turns = random() % (16u << std::min(attempt, 5)); turns > 0; --turns) pause_cpu();
    else
      std::this_thread::sleep_for(std::chrono::microseconds(1 + random() % 50));
  }

  static constexpr int kPoliteAttempts = 16;
  static constexpr std::size_t kFew = 64;

  Tree& tree_;
  bool readers_may_read_;
  SmallVector<ReadVersion, 16> locked_;
};

}  // namespace ztf
