// Mode `optimistic`, the default: readers take no locks and validate what they have read.
//
// Its guards are in reads/guards.hpp, as readers of other processes use them in every mode. A
// commit takes only the SeqLocks of its write set (commits/write_locks.hpp).
//
// Thread safety: every function, from any thread.
#pragma once

#include "base/retries.hpp"
#include "tree_state.hpp"

namespace ztf {

struct Optimistic {
  // The length of each of two series of attempts. A lookup() makes them with a WalkGuard. If all
  // fail, or for a longer transaction, read() makes as many with an OptimisticGuard. Then it locks
  // frames (LockingGuard), which always ends.
  static constexpr int kAttempts = 64;

  // Runs attempt(guard) until it returns true.
  template <class Attempt>
  static void read(const TreeState& tree, ReadSet& reads, Attempt&& attempt) {
    const bool is_read = retry(kAttempts, [&] {
      OptimisticGuard guard(tree.frames, reads);
      return attempt(guard);
    });
    if (is_read) return;
    SmallVector<FrameId, 64> wanted;
    for (const ReadVersion& read : reads) wanted.push_back(read.frame);
    for (;;) {
      LockingGuard guard(tree.frames, reads, wanted);
      if (attempt(guard)) return;
      count_retry();
    }
  }
};

}  // namespace ztf
