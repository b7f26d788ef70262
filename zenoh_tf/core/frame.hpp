// A frame's record and the ring of samples behind it: where every word of the
// tree's data lives.
//
// Thread safety: one writer at a time, who holds the frame (lock_words.hpp). Readers
// may read anything at any time, whatever a writer does: every shared word is
// an atomic, stored with release and loaded with acquire order, and indices are
// masked, so a reader that collides with a writer sees nonsense but never
// leaves the ring, and learns from the version that it was nonsense.
// Invariants, while the frame is not locked
// 1. Static: `latest` is the value for all times, count is 0.
// 2. Otherwise the ring holds `count` samples from index `first` on, of strictly
//    increasing stamps, `latest` and `parent` repeat its newest one, and
//    `oldest_stamp` its oldest one's time. Where `parent_changes` is 0, `parent`
//    is that of all, and the ring's parents mean nothing. `samples_per_ns` is
//    not 0 only then, with two samples at least; it is stored after the ring, so
//    that who has read it finds a ring, in a collision too.
// 3. count 0 and not static: the frame has no parent (root, new, or cleared).
// 4. A ring, once replaced, is kept until the tree dies. Rings double, so what
//    is kept is smaller than what is used.
#pragma once

#include <atomic>
#include <bit>
#include <cstdint>
#include <limits>
#include <new>

#include "lock_words.hpp"
#include "pose.hpp"
#include "ring_arena.hpp"

namespace ztf {

using FrameId = std::uint32_t;  // 1, 2, ... in order of creation; 0: none
using Stamp = std::int64_t;     // nanoseconds

// Fetches a line that will be written, from other processors that have read it as well. (All
// x86-64 processors take the instruction; a compiler that is not told so leaves it out.)
ZTF_ALWAYS_INLINE void prefetch_for_write(const void* line) noexcept {
#if defined(__x86_64__)
  asm volatile("prefetchw %0" ::"m"(*static_cast<const char*>(line)));
#else
  __builtin_prefetch(line, 1);
#endif
}

constexpr Stamp kNoStamp = std::numeric_limits<Stamp>::min();

// The distance from `from` up to `to`, which is not smaller; cannot overflow.
inline std::uint64_t span_ns(Stamp from, Stamp to) noexcept {
  return static_cast<std::uint64_t>(to) - static_cast<std::uint64_t>(from);
}

class AtomicPose {
 public:
  ZTF_ALWAYS_INLINE void store(const Pose& p) noexcept {
    const auto put = [&](int i, double value) {
      values_[i].store(value, std::memory_order_release);
    };
    put(0, p.x), put(1, p.y), put(2, p.z);
    put(3, p.qx), put(4, p.qy), put(5, p.qz), put(6, p.qw);
  }
  // x, y, z, qx, qy, qz, qw
  ZTF_ALWAYS_INLINE double operator[](int i) const noexcept {
    return values_[i].load(std::memory_order_acquire);
  }
  ZTF_ALWAYS_INLINE Pose load() const noexcept {
    const AtomicPose& p = *this;
    return {p[0], p[1], p[2], p[3], p[4], p[5], p[6]};
  }

 private:
  std::atomic<double> values_[7];
};

// One cache line: who looks a time up reads two of them, the time's neighbours.
struct alignas(64) Sample {
  std::atomic<Stamp> stamp;
  AtomicPose pose;
};
static_assert(sizeof(Sample) == 64);

// The samples behind a record, and where they are in memory: one word, the
// address with the capacity's logarithm in the bits that its alignment leaves
// free. So a reader always has an address and a capacity that belong together,
// and finds a sample without another load. Parents stand apart: mostly all are
// the record's, and inserts and lookups leave them alone.
class Ring {
 public:
  Ring() noexcept = default;  // none
  explicit operator bool() const noexcept { return word_ != 0; }

  // Of zeros, which are good for all that is in it. Throws bad_alloc.
  static Ring make(std::uint32_t capacity, RingArena& memory) {
    Ring ring;
    ring.word_ = reinterpret_cast<std::uintptr_t>(memory.allocate(lines(capacity))) |
                 static_cast<std::uintptr_t>(std::countr_zero(capacity));
    return ring;
  }

  [[nodiscard]] ZTF_ALWAYS_INLINE std::uint32_t capacity() const noexcept {
    return std::uint32_t{1} << (word_ & kLogarithm);
  }

  [[nodiscard]] ZTF_ALWAYS_INLINE Sample& sample(std::uint32_t i) const noexcept {
    return samples()[i & (capacity() - 1)];
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE Stamp stamp(std::uint32_t i) const noexcept {
    return sample(i).stamp.load(std::memory_order_acquire);
  }
  // Of one of its samples; in a collision, of another's, anything.
  [[nodiscard]] std::uint32_t index_of(const Sample& sample) const noexcept {
    const auto offset = reinterpret_cast<std::uintptr_t>(&sample) - (word_ & ~kLogarithm);
    return static_cast<std::uint32_t>(offset / sizeof(Sample));
  }
  [[nodiscard]] FrameId parent(std::uint32_t i) const noexcept {
    return parents()[i & (capacity() - 1)].load(std::memory_order_acquire);
  }

  void store(std::uint32_t i, Stamp stamp, const Pose& pose) const noexcept {
    sample(i).stamp.store(stamp, std::memory_order_release);
    sample(i).pose.store(pose);
  }
  void store_parent(std::uint32_t i, FrameId parent) const noexcept {
    parents()[i & (capacity() - 1)].store(parent, std::memory_order_release);
  }
  void copy(std::uint32_t to, Ring from, std::uint32_t i) const noexcept {
    store(to, from.stamp(i), from.sample(i).pose.load());
    store_parent(to, from.parent(i));
  }
  void prefetch(std::uint32_t i) const noexcept { __builtin_prefetch(&sample(i)); }
  void prefetch_for_write(std::uint32_t i) const noexcept { ztf::prefetch_for_write(&sample(i)); }

 private:
  static constexpr std::uintptr_t kLogarithm = 63;

  // The samples, then their parents.
  static std::size_t lines(std::uint32_t capacity) noexcept {
    return capacity + (capacity * sizeof(FrameId) + 63) / 64;
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE Sample* samples() const noexcept {
    return reinterpret_cast<Sample*>(word_ & ~kLogarithm);
  }
  [[nodiscard]] std::atomic<FrameId>* parents() const noexcept {
    return reinterpret_cast<std::atomic<FrameId>*>(samples() + capacity());
  }

  std::uintptr_t word_ = 0;
};

// Two adjacent cache lines, fetched together: what a walk needs, then the
// newest sample. "Latest" reads touch nothing else, which is what makes them
// fast under contention: coherence traffic is the cost, not locking.
struct alignas(128) Frame {
  SeqLock version;
  SharedLock shared;  // two-phase locking only
  std::atomic<FrameId> parent;
  std::atomic<Ring> ring;
  std::atomic<std::uint32_t> first;
  std::atomic<std::uint32_t> count;
  std::atomic<Stamp> oldest_stamp;            // of the ring
  std::atomic<double> samples_per_ns;         // in the ring, on average; 0: not regular
  std::atomic<std::uint32_t> parent_changes;  // in the ring, from one sample to the next
  std::atomic<bool> is_static;
  std::atomic<bool> is_parent;  // has ever been one; written under the topology mutex
  std::atomic<std::uint32_t> authority;
  std::atomic<std::uint32_t> evicted;  // samples that went before their time: the frame was full

  Sample latest;

  void prefetch() const noexcept {
    __builtin_prefetch(&version);
    __builtin_prefetch(&latest);
  }
  void prefetch_for_write() const noexcept {
    ztf::prefetch_for_write(&version);
    ztf::prefetch_for_write(&latest);
  }
};
static_assert(sizeof(Frame) == 128);
static_assert(std::atomic<Ring>::is_always_lock_free);

}  // namespace ztf
