// A read as a transaction, whatever the concurrency control.
//
// Thread safety: as the tree, all of it. For the files that implement the tree's reads.
#pragma once

#include "reader.hpp"
#include "retries.hpp"
#include "tree.hpp"

namespace ztf {

constexpr int kOptimisticAttempts = 64;
constexpr int kHeedWantedAttempts = 8;

template <class Guard>
ZTF_ALWAYS_INLINE Reader<Guard> Tree::reader(Guard& guard) const noexcept {
  return {frames_, guard, options_.max_depth, ever_reparented_};
}

// Runs body(reader) until what it read was the tree's state at one instant.
template <class Body>
void Tree::read(ReadSet& reads, Body&& body) const {
  const auto attempt = [&](auto& guard) {
    Reader own = reader(guard);
    return body(own) && guard.validate_all();
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
        backoff.wait();
      }
    }
    case Concurrency::giant: {
      const std::lock_guard lock(giant_);
      GiantGuard guard(frames_, reads);
      attempt(guard);
      return;
    }
  }
}

}  // namespace ztf
