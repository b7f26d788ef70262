// The folder `records/`: the words in which a tree keeps its state, and their locks.
// In: writes of frames, under their locks. Out: words that any thread may read, and then validates.
// It may include base, geometry.
//
// A frame's record and the ring of samples behind it: where every word of the tree's data lives.
//
// Thread safety: one writer at a time, which holds the frame's write lock (records/lock_words.hpp).
// Readers may read anything at any time. Every shared word is an atomic, stored with release and
// loaded with acquire order, and ring indices are masked. So a torn read yields nonsense, but never
// leaves the ring, and validation of the frame's version rejects it.
// Invariants, while no write is in progress
// 1. A static frame has `is_static` set and count 0; `latest` is its transform for all times.
// 2. A dynamic frame has `count` samples in its ring, from index `first` on, with strictly
//    increasing stamps. `latest` and `parent` repeat the newest sample, `oldest_stamp` the oldest.
// 3. Where `parent_changes` is 0, all samples have the parent `parent`, and the ring's own parents
//    are unspecified. A sample that is not the newest has parent 0 if the id of its
//    parent was freed (commits/freed_names.cpp).
// 4. `samples_per_ns` is 0 unless parent_changes is 0 and count at least 2.
// 5. A frame that is not static and has count 0 has no parent: it is a root, new, or cleared.
// 6. A ring that was replaced or taken away goes to another frame once the frame has a new version
//    (records/ring_arena.hpp).
// 7. Nothing here is an address, so that another process may map frames and rings wherever it
//    likes (records/region.hpp).
#pragma once

#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>

#include "base/stamp.hpp"
#include "geometry/pose.hpp"
#include "records/lock_words.hpp"
#include "records/ring_arena.hpp"

namespace ztf {

static_assert(
    sizeof(void*) == 8,
    "the zenoh-tf core needs a 64-bit target: a ring packs an address and a capacity into "
    "one word, versions are 64-bit words, and names are hashed by 128-bit products");

using FrameId = std::uint32_t;  // 1, 2, ...; freed ones are used again; 0: none

// Prefetches a cache line for writing, so that other cores' copies are invalidated early. On x86-64
// it names the instruction, as compilers emit a read prefetch without -mprfchw. Every x86-64
// processor accepts it. commits/plan.cpp and commits/apply.cpp give the measured gains.
ZTF_ALWAYS_INLINE void prefetch_for_write(const void* line) noexcept {
#if defined(__x86_64__)
  asm volatile("prefetchw %0" ::"m"(*static_cast<const char*>(line)));
#else
  __builtin_prefetch(line, 1);
#endif
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

// A stamped pose in one cache line. A lookup at a time touches two, the time's neighbours.
struct alignas(64) Sample {
  std::atomic<Stamp> stamp;
  AtomicPose pose;
};
static_assert(sizeof(Sample) == 64);

// The samples behind a frame's record: their address and capacity in one word. The low bits, which
// the address leaves free, hold the capacity's logarithm, so both always belong together. The
// samples' parents are stored after all samples. They are rarely touched, as mostly all samples
// have the frame's parent. A ring of capacity 1 is none: a frame without a ring gives its newest
// sample as one, so that a torn read always finds a sample. It has no parents.
class Ring {
 public:
  Ring() noexcept = default;  // none
  explicit operator bool() const noexcept { return (word_ & kLogarithm) != 0; }

  // Returns a ring whose samples are unspecified. Requires a capacity that is a power of two, and
  // at least 2. Throws RingArena::Full and bad_alloc.
  static Ring make(std::uint32_t capacity, RingArena& memory) {
    const auto logarithm = static_cast<unsigned>(std::countr_zero(capacity));
    Ring ring;
    ring.word_ =
        reinterpret_cast<std::uintptr_t>(memory.allocate(logarithm, lines(capacity))) | logarithm;
    return ring;
  }
  // Gives the memory back, under the conditions of RingArena::give_back().
  void give_back(RingArena& memory) const noexcept {
    memory.give_back(static_cast<unsigned>(word_ & kLogarithm),
                     reinterpret_cast<RingArena::Line*>(samples()));
  }

  [[nodiscard]] ZTF_ALWAYS_INLINE std::uint32_t capacity() const noexcept {
    return std::uint32_t{1} << (word_ & kLogarithm);
  }

  // For readers that do not trust the word: false if the capacity is more than any ring has; then
  // only begin() may be called besides.
  [[nodiscard]] ZTF_ALWAYS_INLINE bool has_valid_capacity() const noexcept {
    return (word_ & kLogarithm) <= 30;
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE const void* begin() const noexcept { return samples(); }
  [[nodiscard]] ZTF_ALWAYS_INLINE std::size_t bytes() const noexcept {
    return std::size_t{capacity()} * sizeof(Sample) + (*this ? capacity() * sizeof(FrameId) : 0);
  }
  // None, for the frame of which this is the newest sample.
  static Ring without(const Sample& latest) noexcept {
    return Ring(reinterpret_cast<std::uintptr_t>(&latest));
  }

  [[nodiscard]] ZTF_ALWAYS_INLINE Sample& sample(std::uint32_t i) const noexcept {
    return samples()[i & (capacity() - 1)];
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE Stamp stamp(std::uint32_t i) const noexcept {
    return sample(i).stamp.load(std::memory_order_acquire);
  }
  // Returns the index of a sample of this ring. For another ring's sample, as in a torn read, the
  // result is any number.
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
  // Copies a sample without its parent.
  void copy(std::uint32_t to, Ring from, std::uint32_t i) const noexcept {
    store(to, from.stamp(i), from.sample(i).pose.load());
  }
  void prefetch(std::uint32_t i) const noexcept { __builtin_prefetch(&sample(i)); }
  void prefetch_for_write(std::uint32_t i) const noexcept { ztf::prefetch_for_write(&sample(i)); }

 private:
  friend class RelativeRing;
  static constexpr std::uintptr_t kLogarithm = 63;

  explicit Ring(std::uintptr_t word) noexcept : word_(word) {}
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

// A frame's ring, as the distance from the frame's newest sample to the ring: one addition to an
// address that a reader has at hand (docs/explanation/decisions/0011-trees-in-shared-memory.md). 0
// is none.
class RelativeRing {
 public:
  [[nodiscard]] ZTF_ALWAYS_INLINE Ring
  load(std::memory_order order = std::memory_order_seq_cst) const noexcept {
    return Ring(latest() + distance_.load(order));
  }
  void store(Ring ring, std::memory_order order) noexcept {
    distance_.store(ring ? ring.word_ - latest() : 0, order);
  }

  // From the ring's word to the frame's newest sample.
  static constexpr std::size_t kToLatest = 48;

 private:
  [[nodiscard]] ZTF_ALWAYS_INLINE std::uintptr_t latest() const noexcept {
    return reinterpret_cast<std::uintptr_t>(this) + kToLatest;
  }
  std::atomic<std::uint64_t> distance_;
};

// One frame's record in two adjacent cache lines: what a walk needs, then the newest sample.
// Lookups of newest samples touch nothing else, which keeps them fast under contention, where
// coherence traffic is the cost.
struct alignas(128) Frame {
  SeqLock version;
  SharedLock shared;  // two-phase locking only
  std::atomic<FrameId> parent;
  RelativeRing ring;
  std::atomic<std::uint32_t> first;
  std::atomic<std::uint32_t> count;
  std::atomic<Stamp> oldest_stamp;            // of the ring's samples
  std::atomic<double> samples_per_ns;         // mean rate of the ring's samples; 0: invariant 4
  std::atomic<std::uint32_t> parent_changes;  // how often a ring's sample has another parent than
                                              // the sample before it
  std::atomic<bool> is_static;
  std::atomic<std::uint16_t> authority;  // an AuthorityId (Options::max_authorities)
  std::atomic<std::uint64_t> evicted;    // samples dropped because the frame was full

  Sample latest;

  void prefetch_for_write() const noexcept {
    ztf::prefetch_for_write(&version);
    ztf::prefetch_for_write(&latest);
  }
};
static_assert(sizeof(Frame) == 128);
static_assert(offsetof(Frame, latest) - offsetof(Frame, ring) == RelativeRing::kToLatest);

}  // namespace ztf
