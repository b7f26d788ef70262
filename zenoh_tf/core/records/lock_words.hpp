// The two lock words of a frame, and how threads wait for them.
//
// Thread safety: every function may be called from any thread.
// Invariants
// 1. Waiting writers form no cycle. Writers wait for frames in ascending id. A two-phase reader
//    holds shared locks while it waits for a writer, but a two-phase writer waits for shared locks
//    only while it holds none.
// 2. A lock holder runs a bounded piece of code and never waits for the interpreter lock. A long
//    wait therefore means that the holder has lost its processor, and then sleeping is right.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <thread>
#include <type_traits>

#include "base/compiler.hpp"
#include "base/long_wait.hpp"
#include "base/yield_point.hpp"
#include "records/versions.hpp"

namespace ztf {

inline void pause_cpu() noexcept {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("isb" ::: "memory");
#endif
}

// Spins briefly, then sleeps for longer and longer, because with more threads than cores a spinning
// waiter starves the lock holder. It never yields: a thread that yields gives up the rest of its
// time slice and then waits for those of all others.
class Backoff {
 public:
  void wait() {
    if (!spin()) nap();
  }
  // Pauses for one spin. Returns false, without pausing, once all spins before a nap are used up.
  bool spin() noexcept {
    if (spins_ >= kSpins) return false;
    ++spins_;
    pause_cpu();
    return true;
  }
  // Announces a long wait, sleeps for 5 to 80 microseconds, twice as long each time, and allows
  // new spins.
  void nap() {
    LongWait::announce();
    std::this_thread::sleep_for(std::chrono::microseconds(5) * (1 << naps_));
    naps_ = std::min(naps_ + 1, 4);
    spins_ = 0;
  }

 private:
  static constexpr int kSpins = 256;
  int spins_ = 0, naps_ = 0;
};

// A frame's sequence lock (seqlock) and its writer lock, in one word.
//
// Bit 1 (kWriteLocked): a thread has the writer lock, and other writers wait. Bit 0 (kWriting): its
// write is in progress, and readers wait, too. The other bits are the version
// (records/versions.hpp). A writer that reads before it writes sets bit 0 late, so that readers run
// on meanwhile.
//
// Memory order: a writer sets kWriting, stores the data with release order, and unlocks. A reader
// loads the version, loads data with acquire order, and loads the version again. If it has seen any
// of the writer's data, the second load must see kWriting or a later version. An unchanged version
// therefore means that no load was torn.
class SeqLock {
 public:
  // Returns the version as it is now, without kWriteLocked. kWriting is set while a write is in
  // progress. Does not wait.
  [[nodiscard]] ZTF_ALWAYS_INLINE Version current() const noexcept {
    return word_.load(std::memory_order_seq_cst) & ~kWriteLocked;
  }
  // Waits until no write is in progress and returns the version.
  [[nodiscard]] ZTF_ALWAYS_INLINE Version read_begin() const {
    const Version version = current();
    return version & kWriting ? wait_for_writer() : version;
  }

  // The same, but waits only as long as wait() returns true. Then returns a version that no frame
  // ever has, so that its validation fails. A boolean result would take a third off the speed of
  // the shortest lookups.
  template <class Wait>
  ZTF_ALWAYS_INLINE Version read_begin(Wait&& wait) const {
    const Version version = current();
    return version & kWriting ? wait_for_writer(wait) : version;
  }

  // Calls read(version) until no write happened during the call, and returns its result. Discarded
  // calls may see torn values. After kOptimisticReads failed attempts it takes the writer lock, so
  // that it ends however often others write. If the caller holds that lock, nobody else can write,
  // and the first attempt succeeds.
  template <class Read>
  ZTF_ALWAYS_INLINE auto read_consistent(Read&& read) const {
    static_assert(std::is_nothrow_invocable_v<Read, Version>, "an exception would leave it locked");
    const Version version = read_begin();
    const auto result = read(version);
    yield_point();
    if (current() == version) [[likely]]
      return result;
    return read_again(read);
  }

  // Takes the writer lock and sets `before` to the version. Returns false if another thread has it.
  bool try_lock_writer(Version& before) const { return try_set(kWriteLocked, before); }
  // The same, and begins the write in the same step, so that readers wait, too.
  bool try_lock_and_begin_write(Version& before) {
    return try_set(kWriteLocked | kWriting, before);
  }
  // Waits for the writer lock and returns the version. A reader may use it to keep writers out.
  Version lock_writer() const {
    Backoff backoff;
    Version before;
    while (!try_lock_writer(before)) backoff.wait();
    return before;
  }
  // The same, and begins the write in the same step, so that readers wait, too.
  Version lock_and_begin_write() {
    Backoff backoff;
    Version before;
    while (!try_lock_and_begin_write(before)) backoff.wait();
    return before;
  }
  // Makes readers wait from now on. Requires the writer lock. The caller needs a sequentially
  // consistent fence between this and the unlock (WriteLocks).
  void begin_write(Version before) noexcept {
    word_.store(before | kWriteLocked | kWriting, std::memory_order_relaxed);
  }

  // Releases the writer lock, ends the write, and gives the frame this version.
  void unlock_changed(Version after) noexcept {
    yield_point();
    word_.store(after, std::memory_order_release);
  }
  // Releases the writer lock and restores the version. Requires that nothing was written.
  void unlock_unchanged(Version before) const noexcept {
    word_.store(before, std::memory_order_release);
  }

  static constexpr Version kWriting = 1;
  static constexpr Version kWriteLocked = 2;
  static constexpr int kOptimisticReads = 64;

 private:
  bool try_set(Version bits, Version& before) const {
    before = word_.load(std::memory_order_relaxed);
    if (before & (kWriteLocked | kWriting)) return false;
    if (!word_.compare_exchange_strong(before, before | bits, std::memory_order_seq_cst,
                                       std::memory_order_relaxed))
      return false;
    yield_point();
    return true;
  }
  // The remaining attempts of read_consistent().
  template <class Read>
  [[gnu::noinline, gnu::cold]] auto read_again(Read& read) const {
    for (int attempt = 1; attempt < kOptimisticReads; ++attempt) {
      const Version version = read_begin();
      const auto result = read(version);
      yield_point();
      if (current() == version) return result;
    }
    const Version version = lock_writer();
    const auto result = read(version);
    unlock_unchanged(version);
    return result;
  }
  template <class Wait>
  [[gnu::noinline, gnu::cold]] Version wait_for_writer(Wait& wait) const {
    while (wait())
      if (const Version version = current(); !(version & kWriting)) return version;
    return ~Version{0};  // with kWriteLocked, which current() never returns
  }
  [[gnu::noinline, gnu::cold]] Version wait_for_writer() const {
    Backoff backoff;
    for (;;) {
      backoff.wait();
      const Version version = current();
      if (!(version & kWriting)) return version;
    }
  }

  // Mutable, because a reader of a const frame may lock it, as with a mutable mutex.
  mutable std::atomic<Version> word_;
};

// A frame's reader-writer lock for two-phase locking. The word holds the number of readers, a
// writer bit, and a bit by which a starving writer asks new readers to stay away.
class SharedLock {
 public:
  enum class TryResult {
    acquired,
    writer_holds,  // a writer has the lock
    writer_wants,  // a starving writer has called want(); only with `heed_wanted`
  };

  // Takes a shared lock, or returns why not.
  TryResult try_lock_shared(bool heed_wanted) noexcept {
    std::uint32_t state = word_.load(std::memory_order_relaxed);
    for (;;) {
      if (state & kWriter) return TryResult::writer_holds;
      if (heed_wanted && (state & kWanted)) return TryResult::writer_wants;
      if (word_.compare_exchange_weak(state, state + 1, std::memory_order_seq_cst,
                                      std::memory_order_relaxed))
        return TryResult::acquired;
    }
  }
  void unlock_shared() noexcept { word_.fetch_sub(1, std::memory_order_release); }

  // Takes the exclusive lock and resets the wanted bit. Returns false if anyone holds the lock.
  bool try_lock() noexcept {
    std::uint32_t state = word_.load(std::memory_order_relaxed);
    if (state & ~kWanted) return false;
    return word_.compare_exchange_strong(state, kWriter, std::memory_order_seq_cst,
                                         std::memory_order_relaxed);
  }
  // Asks new readers to stay away, until a writer takes the lock.
  void want() noexcept { word_.fetch_or(kWanted, std::memory_order_relaxed); }
  void unlock() noexcept { word_.fetch_and(~kWriter, std::memory_order_release); }

 private:
  static constexpr std::uint32_t kWriter = 1u << 31;
  static constexpr std::uint32_t kWanted = 1u << 30;
  std::atomic<std::uint32_t> word_;
};

}  // namespace ztf
