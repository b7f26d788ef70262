// Changing one frame's history: inserting a sample, making a frame static, dropping everything.
//
// Thread safety: every function requires the frame's write lock, and that readers already wait
// (SeqLock::begin_write). reserve() and prefetch_history() are the exceptions: see there.
// Rules: those of history.hpp. The caller has dropped samples that are too old.
// Invariants: frame.hpp's hold again when a function returns. In between a reader may see any
// mixture, which validation rejects.
#pragma once

#include <algorithm>

#include "history.hpp"

namespace ztf {

struct HistoryLimits {
  std::uint64_t cache_ns;
  std::uint32_t max_samples;
};

enum class InsertResult : std::uint8_t {
  added,
  replaced,  // a sample of the same stamp was replaced
  rejected,  // the frame is full of newer samples
};

// Adds one to a counter of a frame. Requires the frame's write lock, so a plain load and store
// suffice; an atomic add would drain the store buffer. The store is a release, so that it cannot
// become visible before the lock: on ARM a relaxed store may overtake the store half of the
// compare-and-swap that took the lock, and a reader would validate a count it must not see yet.
inline void increment(std::atomic<std::uint32_t>& counter) noexcept {
  counter.store(counter.load(std::memory_order_relaxed) + 1, std::memory_order_release);
}

inline void store_latest(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
  frame.parent.store(parent, std::memory_order_release);
  frame.latest.stamp.store(stamp, std::memory_order_release);
  frame.latest.pose.store(pose);
}

// Leaves the frame without samples and without a parent.
inline void clear_history(Frame& frame) noexcept {
  frame.is_static.store(false, std::memory_order_release);
  frame.samples_per_ns.store(0, std::memory_order_release);
  frame.count.store(0, std::memory_order_release);
  frame.parent.store(0, std::memory_order_release);
}

// Replaces the frame's history by one transform for all times.
inline void set_static(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
  frame.samples_per_ns.store(0, std::memory_order_release);
  frame.count.store(0, std::memory_order_release);
  frame.is_static.store(true, std::memory_order_release);
  store_latest(frame, stamp, parent, pose);
}

// Replaces the ring by one of at least `wanted` slots. Requires the write lock only: readers may
// go on meanwhile. Throws bad_alloc.
void grow_ring(Frame& frame, std::uint64_t wanted, RingArena& memory);

// Makes room for `extra` more samples, so that insert() cannot fail. Requires the write lock only,
// as it changes nothing that a reader sees. Throws bad_alloc.
inline void reserve(Frame& frame, std::uint32_t extra, const HistoryLimits& limits,
                    RingArena& memory) {
  const Ring ring = frame.ring.load(std::memory_order_relaxed);
  const std::uint64_t wanted = std::min<std::uint64_t>(
      std::uint64_t{frame.count.load(std::memory_order_relaxed)} + extra, limits.max_samples);
  if (!ring || ring.capacity() < wanted) grow_ring(frame, wanted, memory);
}

// Prefetches the slots that an insert of a newer sample stores to and reads. Requires nothing: what
// another writer changes meanwhile only makes the wrong lines come.
inline void prefetch_history(const Frame& frame) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const Ring ring = frame.ring.load(relaxed);
  if (!ring) return;
  const std::uint32_t first = frame.first.load(relaxed);
  ring.prefetch_for_write(first + frame.count.load(relaxed));
  ring.prefetch(first + 1);  // the oldest sample, once the insert has pruned the first
}

// A frame's samples during one insert: a copy of the words that say which slots are used. Sample i
// is the i-th oldest. Nothing shows in those words before publish().
class RingEdit {
 public:
  // For a sample of that parent. Requires the write lock. The ring's parents are kept up to date
  // only where the samples differ in it; this fills them in when a second parent comes.
  ZTF_ALWAYS_INLINE RingEdit(const Frame& frame, FrameId parent) noexcept
      : ring_(frame.ring.load(std::memory_order_relaxed)),
        first_(frame.first.load(std::memory_order_relaxed)),
        count_(frame.count.load(std::memory_order_relaxed)),
        parent_changes_(count_ == 0 ? 0 : frame.parent_changes.load(std::memory_order_relaxed)) {
    const FrameId newest_parent = frame.parent.load(std::memory_order_relaxed);
    if (parent_changes_ == 0 && (count_ == 0 || newest_parent == parent)) return;
    has_parents_ = true;
    if (parent_changes_ == 0) fill_in_parents(newest_parent);
  }

  [[nodiscard]] std::uint32_t count() const noexcept { return count_; }
  [[nodiscard]] Stamp stamp(std::uint32_t i) const noexcept { return ring_.stamp(first_ + i); }
  // The number of samples that are not newer than the stamp: where it would be inserted.
  [[nodiscard]] std::uint32_t place_of(Stamp stamp) const noexcept;

  ZTF_ALWAYS_INLINE void drop_oldest() noexcept {
    if (has_parents_) [[unlikely]]
      parent_changes_ -= changes_around(0);
    ++first_;
    --count_;
  }
  // Frees slot `i` by moving all newer samples up by one. Requires a free slot in the ring.
  ZTF_ALWAYS_INLINE void open_slot(std::uint32_t i) noexcept {
    if (i != count_) [[unlikely]]
      move_up(i);
    ++count_;
  }
  void forget_parent(std::uint32_t i) noexcept {
    if (has_parents_) parent_changes_ -= changes_around(i);
  }
  ZTF_ALWAYS_INLINE void store(std::uint32_t i, Stamp stamp, FrameId parent,
                               const Pose& pose) noexcept {
    ring_.store(first_ + i, stamp, pose);
    if (has_parents_) [[unlikely]] {
      ring_.store_parent(first_ + i, parent);
      parent_changes_ += changes_around(i);
    }
  }

  // The last stores of an insert: which of the ring's samples are the frame's.
  ZTF_ALWAYS_INLINE void publish(Frame& frame, Stamp oldest, Stamp newest) const noexcept {
    const auto release = std::memory_order_release;
    frame.is_static.store(false, release);
    frame.parent_changes.store(parent_changes_, release);
    frame.oldest_stamp.store(oldest, release);
    frame.samples_per_ns.store(parent_changes_ == 0 ? mean_sample_rate(count_, oldest, newest) : 0,
                               release);
    frame.first.store(first_, release);
    frame.count.store(count_, release);
  }

 private:
  void fill_in_parents(FrameId parent) const noexcept;
  void move_up(std::uint32_t i) noexcept;
  // How often the parent changes between sample i and its neighbours.
  [[nodiscard]] std::uint32_t changes_around(std::uint32_t i) const noexcept;

  const Ring ring_;
  std::uint32_t first_, count_;
  std::uint32_t parent_changes_;
  bool has_parents_ = false;  // the samples have two parents or more, before or after this insert
};

// Inserts a sample, after reserve(). A full frame evicts its oldest sample for it; samples that are
// older than the cache time are pruned. The sample must not be too old itself.
inline InsertResult insert(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose,
                           const HistoryLimits& limits) noexcept {
  RingEdit ring(frame, parent);
  const Stamp newest_before = frame.latest.stamp.load(std::memory_order_relaxed);
  Stamp oldest = frame.oldest_stamp.load(std::memory_order_relaxed);
  const bool is_newest = ring.count() == 0 || stamp > newest_before;  // the common case
  std::uint32_t place = is_newest ? ring.count() : ring.place_of(stamp);

  const bool replaces = !is_newest && place > 0 && ring.stamp(place - 1) == stamp;
  if (replaces) {
    ring.forget_parent(--place);
  } else {
    if (ring.count() == limits.max_samples) {
      if (place == 0) return InsertResult::rejected;
      ring.drop_oldest();
      --place;
      oldest = ring.stamp(0);  // the new sample's slot where that was the only one
      increment(frame.evicted);
    }
    ring.open_slot(place);
  }
  ring.store(place, stamp, parent, pose);
  if (place == 0) oldest = stamp;
  const Stamp newest = is_newest ? stamp : newest_before;
  if (place == ring.count() - 1) store_latest(frame, stamp, parent, pose);

  while (too_old(oldest, newest, limits.cache_ns)) {
    ring.drop_oldest();
    oldest = ring.stamp(0);
  }
  ring.publish(frame, oldest, newest);
  return replaces ? InsertResult::replaced : InsertResult::added;
}

}  // namespace ztf
