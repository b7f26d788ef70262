// The two lock words of a frame, and how threads wait for them.
//
// Invariants
// 1. Nobody waits for a lock while it holds one that others could be waiting
//    for in another order: writers lock in ascending frame id, two-phase
//    readers wait holding shared locks only for writers, and two-phase writers
//    never wait holding anything.
// 2. A holder never blocks: it runs a bounded piece of code without the
//    interpreter lock. A wait is therefore long only where the holder has lost
//    its processor, and then sleeping is right.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <thread>

#include "fault_points.hpp"
#include "pose.hpp"

namespace ztf {

inline void pause_cpu() noexcept {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("isb" ::: "memory");
#endif
}

// Spin briefly, then give up the processor, then sleep for longer and longer:
// with more threads than cores, a spinning waiter starves the holder.
class Backoff {
 public:
  void wait() {
    ++turns_;
    if (turns_ <= 64) {
      pause_cpu();
    } else if (turns_ <= 96) {
      std::this_thread::yield();
    } else {
      const auto nap = std::chrono::microseconds(20) * (1 << std::min(turns_ - 97, 5));
      std::this_thread::sleep_for(nap);
    }
  }

 private:
  int turns_ = 0;
};

using Version = std::uint64_t;

// A frame's version word: bit 0 says "locked by a writer", the rest counts
// commits. 0 is a frame that was never written.
//
// Ordering. A writer locks (sequentially consistent), stores the frame's data
// with release order, unlocks. A reader takes the version, loads data with
// acquire order, and loads the version again (sequentially consistent): had it
// seen any of the writer's data, that acquire would make the writer's lock
// visible to the second load, so an unchanged version means unmixed data.
class VersionLock {
 public:
  // As it is now; locked where bit 0 is set.
  [[nodiscard]] Version load() const noexcept { return word_.load(std::memory_order_seq_cst); }

  // Waits until no writer holds it.
  [[nodiscard]] ZTF_HOT Version unlocked() const {
    const Version version = load();
    return version & kLocked ? wait_unlocked() : version;
  }

  // Waits for the lock; returns the version before.
  Version lock() {
    Backoff backoff;
    for (;;) {
      Version version = word_.load(std::memory_order_relaxed);
      if (!(version & kLocked) &&
          word_.compare_exchange_weak(version, version | kLocked, std::memory_order_seq_cst,
                                      std::memory_order_relaxed)) {
        fault_point();
        return version;
      }
      backoff.wait();
    }
  }

  // For who is already alone (two-phase and giant writers): marks the frame as
  // being written. An exchange, so that it is ordered before the validation of
  // what the same transaction has read (else two could miss each other).
  Version mark() noexcept {
    const Version version = word_.load(std::memory_order_relaxed);
    word_.exchange(version | kLocked, std::memory_order_seq_cst);
    return version;
  }

  void unlock_changed(Version before) noexcept {
    fault_point();
    word_.store(before + kCommit, std::memory_order_release);
  }
  void unlock_unchanged(Version before) noexcept { word_.store(before, std::memory_order_release); }

  static constexpr Version kLocked = 1;
  static constexpr Version kCommit = 2;

 private:
  [[gnu::noinline, gnu::cold]] Version wait_unlocked() const {
    Backoff backoff;
    for (;;) {
      backoff.wait();
      const Version version = load();
      if (!(version & kLocked)) return version;
    }
  }

  std::atomic<Version> word_;
};

// A frame's readers-writer word for two-phase locking: the number of readers,
// a writer bit, and a bit by which a writer that keeps failing asks newcomers
// to stay away.
class SharedLock {
 public:
  enum class Shared { taken, writer, wanted };

  Shared try_lock_shared(bool heed_wanted) noexcept {
    std::uint32_t state = word_.load(std::memory_order_relaxed);
    for (;;) {
      if (state & kWriter) return Shared::writer;
      if (heed_wanted && (state & kWanted)) return Shared::wanted;
      if (word_.compare_exchange_weak(state, state + 1, std::memory_order_seq_cst,
                                      std::memory_order_relaxed))
        return Shared::taken;
    }
  }
  void unlock_shared() noexcept { word_.fetch_sub(1, std::memory_order_release); }

  bool try_lock() noexcept {
    std::uint32_t state = word_.load(std::memory_order_relaxed);
    if (state & ~kWanted) return false;  // a writer, or readers
    return word_.compare_exchange_strong(state, kWriter, std::memory_order_seq_cst,
                                         std::memory_order_relaxed);
  }
  void want() noexcept { word_.fetch_or(kWanted, std::memory_order_relaxed); }
  void unlock() noexcept { word_.fetch_and(~kWriter, std::memory_order_release); }

 private:
  static constexpr std::uint32_t kWriter = 1u << 31;
  static constexpr std::uint32_t kWanted = 1u << 30;
  std::atomic<std::uint32_t> word_;
};

}  // namespace ztf
