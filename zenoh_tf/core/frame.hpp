// A frame's record and the ring of samples behind it: where every word of the
// tree's data lives.
//
// Thread safety: one writer at a time, who holds the frame (locks.hpp). Readers
// may read anything at any time, whatever a writer does: every shared word is
// an atomic, stored with release and loaded with acquire order, and indices are
// masked, so a reader that collides with a writer sees nonsense but never
// leaves the ring, and learns from the version that it was nonsense.
// Invariants, while the frame is not locked
// 1. kStatic: `latest` is the value for all times, count is 0.
// 2. Otherwise the ring holds `count` samples from index `first` on, of strictly
//    increasing stamps, `latest` and `parent` repeat its newest one, and
//    `oldest_stamp` its oldest one's time. Where `parent_changes` is 0, `parent`
//    is that of all.
// 3. count 0 and not kStatic: the frame has no parent (root, new, or cleared).
// 4. A ring, once replaced, is kept until the frame dies. Rings double, so what
//    is kept is smaller than what is used.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>
#include <new>

#include "locks.hpp"
#include "pose.hpp"

namespace ztf {

using FrameId = std::uint32_t;  // 1, 2, ... in order of creation; 0: none
using Stamp = std::int64_t;     // nanoseconds

constexpr Stamp kNoStamp = std::numeric_limits<Stamp>::min();

// The distance from `from` up to `to`, which is not smaller; cannot overflow.
inline std::uint64_t span_ns(Stamp from, Stamp to) noexcept {
  return static_cast<std::uint64_t>(to) - static_cast<std::uint64_t>(from);
}

class SharedPose {
 public:
  void store(const Pose& p) noexcept {
    const double values[7] = {p.x, p.y, p.z, p.qx, p.qy, p.qz, p.qw};
    for (int i = 0; i < 7; ++i) values_[i].store(values[i], std::memory_order_release);
  }
  // x, y, z, qx, qy, qz, qw
  ZTF_HOT double operator[](int i) const noexcept {
    return values_[i].load(std::memory_order_acquire);
  }
  ZTF_HOT Pose load() const noexcept {
    const SharedPose& p = *this;
    return {p[0], p[1], p[2], p[3], p[4], p[5], p[6]};
  }

 private:
  std::atomic<double> values_[7];
};

// One cache line: who looks a time up reads two of them, the time's neighbours.
struct alignas(64) Sample {
  std::atomic<Stamp> stamp;
  SharedPose pose;
};
static_assert(sizeof(Sample) == 64);

// Parents stand apart: mostly all are the record's, and nobody reads them.
class Ring {
 public:
  static Ring* make(std::uint32_t capacity, Ring* smaller) {
    const std::size_t bytes = sizeof(Ring) + capacity * (sizeof(Sample) + sizeof(FrameId));
    return new (::operator new(bytes, std::align_val_t{64})) Ring(capacity, smaller);
  }
  // Frees this ring and all that it replaced.
  static void free_all(Ring* ring) noexcept {
    while (ring) {
      Ring* smaller = ring->smaller_;
      ::operator delete(ring, std::align_val_t{64});
      ring = smaller;
    }
  }

  [[nodiscard]] std::uint32_t capacity() const noexcept { return mask_ + 1; }

  [[nodiscard]] ZTF_HOT Stamp stamp(std::uint32_t i) const noexcept {
    return samples()[i & mask_].stamp.load(std::memory_order_acquire);
  }
  [[nodiscard]] ZTF_HOT const SharedPose& pose(std::uint32_t i) const noexcept {
    return samples()[i & mask_].pose;
  }
  [[nodiscard]] FrameId parent(std::uint32_t i) const noexcept {
    return parents_[i & mask_].load(std::memory_order_acquire);
  }

  void store(std::uint32_t i, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
    Sample& sample = const_cast<Sample&>(samples()[i & mask_]);
    sample.stamp.store(stamp, std::memory_order_release);
    sample.pose.store(pose);
    parents_[i & mask_].store(parent, std::memory_order_release);
  }
  void copy(std::uint32_t to, const Ring& from, std::uint32_t i) noexcept {
    store(to, from.stamp(i), from.parent(i), from.pose(i).load());
  }

 private:
  Ring(std::uint32_t capacity, Ring* smaller) noexcept
      : mask_(capacity - 1),
        smaller_(smaller),
        parents_(reinterpret_cast<std::atomic<FrameId>*>(const_cast<Sample*>(samples()) + capacity)) {
    for (std::uint32_t i = 0; i < capacity; ++i) {
      new (const_cast<Sample*>(samples()) + i) Sample();
      new (&parents_[i]) std::atomic<FrameId>(0);
    }
  }
  // Behind this, without a pointer to load first.
  [[nodiscard]] ZTF_HOT const Sample* samples() const noexcept {
    return reinterpret_cast<const Sample*>(this + 1);
  }

  alignas(64) const std::uint32_t mask_;
  Ring* const smaller_;
  std::atomic<FrameId>* const parents_;
};
static_assert(sizeof(Ring) == 64);

// Two adjacent cache lines, fetched together: what a walk needs, then the
// newest sample. "Latest" reads touch nothing else, which is what makes them
// fast under contention: coherence traffic is the cost, not locking.
struct alignas(128) Frame {
  VersionLock version;
  SharedLock shared;  // two-phase locking only
  std::atomic<FrameId> parent;
  std::atomic<Ring*> ring;
  std::atomic<std::uint32_t> first;
  std::atomic<std::uint32_t> count;
  std::atomic<Stamp> oldest_stamp;           // of the ring
  std::atomic<std::uint32_t> parent_changes;  // in the ring, from one sample to the next
  std::atomic<bool> is_static;
  std::atomic<bool> is_parent;  // has ever been one; written under the topology mutex
  std::atomic<std::uint32_t> authority;
  std::atomic<std::uint32_t> waiters;  // lookups that wait for a commit on it (waiting.hpp)

  alignas(64) std::atomic<Stamp> latest_stamp;
  SharedPose latest_pose;

  ~Frame() { Ring::free_all(ring.load(std::memory_order_relaxed)); }
};
static_assert(sizeof(Frame) == 128);

}  // namespace ztf
