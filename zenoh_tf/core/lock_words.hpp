// The two lock words of a frame, and how threads wait for them.
//
// Invariants
// 1. Nobody waits for a lock while it holds one that others could be waiting
//    for in another order: writers wait in ascending frame id, two-phase
//    readers wait holding shared locks only for writers, and two-phase writers
//    never wait holding anything.
// 2. A holder hardly ever blocks: it runs a bounded piece of code without the
//    interpreter lock. A wait is therefore long only where the holder has lost
//    its processor, and then sleeping is right.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <thread>

#include "pose.hpp"
#include "yield_point.hpp"

namespace ztf {

inline void pause_cpu() noexcept {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("isb" ::: "memory");
#endif
}

// Spin briefly, then sleep for longer and longer: with more threads than cores, a
// spinning waiter starves the holder. No yielding between: who yields gives away all
// that it had left of its turn, and then waits for everyone else's.
class Backoff {
 public:
  void wait() {
    if (!spin()) nap();
  }
  // False: it has been long enough.
  bool spin() noexcept {
    if (turns_ >= kSpins) return false;
    ++turns_;
    pause_cpu();
    return true;
  }
  void nap() {
    std::this_thread::sleep_for(std::chrono::microseconds(5) * (1 << naps_));
    naps_ = std::min(naps_ + 1, 4);
    turns_ = 0;
  }

 private:
  static constexpr int kSpins = 256;
  int turns_ = 0, naps_ = 0;
};

using Version = std::uint64_t;

// A frame's version word: bit 0 says "being changed", for which readers wait; bit
// 1 says "a writer has it", which other writers wait for; the rest counts
// commits. 0 is a frame that was never written.
//
// So a writer that has to look before it writes keeps readers off only while it
// writes: if it loses its processor before, they go on with the state as it was.
//
// Ordering. A writer has the frame and holds readers off, then stores the frame's
// data with release order, then unlocks. A reader takes the version, loads data
// with acquire order, and loads the version again (sequentially consistent): had it
// seen any of the writer's data, that acquire would make bit 0 visible to the
// second load, so an unchanged version means unmixed data.
class SeqLock {
 public:
  // As it is for readers: being changed where bit 0 is set.
  [[nodiscard]] ZTF_ALWAYS_INLINE Version load() const noexcept {
    return word_.load(std::memory_order_seq_cst) & ~kWriteLocked;
  }
  // Waits until it is not being changed.
  [[nodiscard]] ZTF_ALWAYS_INLINE Version read_begin() const {
    const Version version = load();
    return version & kWriting ? wait_for_writer() : version;
  }

  // False where another has it; else gives the version before.
  bool try_lock_writer(Version& before) { return try_set(kWriteLocked, before); }
  // The same, and holds readers off at once.
  bool try_lock(Version& before) { return try_set(kWriteLocked | kWriting, before); }
  // Waits for it. Also for readers that want it to stand still.
  Version lock_writer() {
    Backoff backoff;
    Version before;
    while (!try_lock_writer(before)) backoff.wait();
    return before;
  }
  // try_lock() for who is already alone (two-phase and giant writers).
  Version begin_write_exclusive() noexcept {
    const Version version = word_.load(std::memory_order_relaxed);
    word_.exchange(version | kWriteLocked | kWriting, std::memory_order_seq_cst);
    return version;
  }
  // For who owns it, or is alone. Comes before the data is stored; a fence must come between
  // it and the unlocking (WriteLocks).
  void begin_write(Version before) noexcept {
    word_.store(before | kWriteLocked | kWriting, std::memory_order_relaxed);
  }

  void unlock_changed(Version before) noexcept {
    yield_point();
    word_.store(before + kIncrement, std::memory_order_release);
  }
  void unlock_unchanged(Version before) noexcept { word_.store(before, std::memory_order_release); }

  static constexpr Version kWriting = 1;
  static constexpr Version kWriteLocked = 2;
  static constexpr Version kIncrement = 4;

 private:
  bool try_set(Version bits, Version& before) {
    before = word_.load(std::memory_order_relaxed);
    if (before & (kWriteLocked | kWriting)) return false;
    if (!word_.compare_exchange_strong(before, before | bits, std::memory_order_seq_cst,
                                       std::memory_order_relaxed))
      return false;
    yield_point();
    return true;
  }
  [[gnu::noinline, gnu::cold]] Version wait_for_writer() const {
    Backoff backoff;
    for (;;) {
      backoff.wait();
      const Version version = load();
      if (!(version & kWriting)) return version;
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
