// The room `lookups/`: the lookups of a tree of this process or of a shared one.
// In: queries. Out: answers, validated; a lookup that fails too often takes locks.
// It may include base, geometry, reads, shared, tree.hpp.
//
// Read-only transactions of the tree, under each concurrency control. Included only by the files
// that implement the tree's reads.
//
// Thread safety: any thread, like the tree's public functions.
#pragma once

#include "base/retries.hpp"
#include "reads/any_tree.hpp"
#include "reads/reader.hpp"
#include "tree.hpp"

namespace ztf {

// The length of each of two series of optimistic attempts. Tree::lookup() makes 64 with a
// WalkGuard. If all fail, or for a longer transaction, Tree::read() makes 64 with an
// OptimisticGuard. Then it locks frames (LockingGuard), which always ends.
constexpr int kOptimisticAttempts = 64;
// Two-phase locking: after so many attempts a reader no longer yields to a starving writer.
constexpr int kHeedWantedAttempts = 8;

template <class Guard>
ZTF_ALWAYS_INLINE Reader<Guard, FrameAccess> Tree::reader(Guard& guard) const noexcept {
  return {FrameAccess(frames_), guard, options_.max_path(), ever_reparented_, ids_freed_};
}

// Runs body(reader) until everything that it read was the tree's state at one instant. `reads` is
// then the read set. If optimistic attempts fail too often, it locks the frames.
template <class Body>
void Tree::read(ReadSet& reads, Body&& body) const {
  const auto attempt = [&](auto& guard) {
    Reader attempt_reader = reader(guard);
    return body(attempt_reader) && guard.validate_all();
  };
  switch (options_.concurrency) {
    case Concurrency::optimistic: {
      for (int i = 0; i < kOptimisticAttempts; ++i) {
        OptimisticGuard guard(frames_, reads);
        if (attempt(guard)) return;
        count_retry();
      }
      SmallVector<FrameId, 64> wanted;
      for (const ReadVersion& read : reads) wanted.push_back(read.frame);
      for (;;) {
        LockingGuard guard(frames_, reads, wanted);
        if (attempt(guard)) return;
        count_retry();
      }
    }
    case Concurrency::two_phase: {
      Backoff backoff;
      for (int i = 0;; ++i) {
        {
          SharedGuard guard(frames_, reads, i < kHeedWantedAttempts);
          if (attempt(guard)) return;
        }
        count_retry();
        backoff.nap();  // a writer that starves sleeps between its attempts: spins are too short
      }
    }
    case Concurrency::giant: {
      const auto lock = lock_announced(giant_);
      GiantGuard guard(frames_, reads);
      attempt(guard);
      return;
    }
  }
}

}  // namespace ztf
