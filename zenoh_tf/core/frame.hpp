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
//    increasing stamps, and `latest` and `parent` repeat its newest one.
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

// Columns, so that a search by stamp touches few cache lines.
class Ring {
 public:
  static Ring* make(std::uint32_t capacity, Ring* smaller) {
    const std::size_t bytes =
        sizeof(Ring) + capacity * (sizeof(SharedPose) + sizeof(Stamp) + sizeof(FrameId));
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

  [[nodiscard]] Stamp stamp(std::uint32_t i) const noexcept {
    return stamps_[i & mask_].load(std::memory_order_acquire);
  }
  [[nodiscard]] FrameId parent(std::uint32_t i) const noexcept {
    return parents_[i & mask_].load(std::memory_order_acquire);
  }
  [[nodiscard]] Pose pose(std::uint32_t i) const noexcept { return poses_[i & mask_].load(); }

  void store(std::uint32_t i, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
    stamps_[i & mask_].store(stamp, std::memory_order_release);
    parents_[i & mask_].store(parent, std::memory_order_release);
    poses_[i & mask_].store(pose);
  }
  void copy(std::uint32_t to, const Ring& from, std::uint32_t i) noexcept {
    store(to, from.stamp(i), from.parent(i), from.pose(i));
  }

 private:
  Ring(std::uint32_t capacity, Ring* smaller) noexcept : mask_(capacity - 1), smaller_(smaller) {
    char* place = reinterpret_cast<char*>(this) + sizeof(Ring);
    poses_ = reinterpret_cast<SharedPose*>(place);
    stamps_ = reinterpret_cast<std::atomic<Stamp>*>(place += capacity * sizeof(SharedPose));
    parents_ = reinterpret_cast<std::atomic<FrameId>*>(place + capacity * sizeof(Stamp));
    for (std::uint32_t i = 0; i < capacity; ++i) {
      new (&poses_[i]) SharedPose();
      new (&stamps_[i]) std::atomic<Stamp>(0);
      new (&parents_[i]) std::atomic<FrameId>(0);
    }
  }

  const std::uint32_t mask_;
  Ring* const smaller_;
  SharedPose* poses_;
  std::atomic<Stamp>* stamps_;
  std::atomic<FrameId>* parents_;
};

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
