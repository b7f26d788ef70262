// Changing one frame's history: inserting a sample, making a frame static, dropping everything.
//
// Thread safety: every function requires the frame's write lock, and that SeqLock::begin_write()
// has been called. What prepares a ring requires only the lock, prefetch_history() nothing.
// Rules (tf2's, except those marked *)
// 1. Samples are kept in the order of their stamps; a late one is inserted at its place.
// 2. At an equal stamp the last one inserted wins*.
// 3. A sample older than newest - cache is too old to be inserted; one exactly that old is not. The
//    caller has dropped those that are too old.
// 4. After the insert*, samples are pruned by the same limit.
// 5. A full frame evicts its oldest sample for a new one*, and rejects one older than all*. A
//    sample that rule 4 would prune anyway does not count as evicted.
// 6. A static transform replaces a dynamic one with its history, and vice versa.
// Invariants: records/frame.hpp's hold again when a function returns. In between a reader may see
// any mixture, which validation rejects.
#pragma once

#include <algorithm>
#include <span>

#include "histories/history.hpp"

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
// suffice; an atomic add would drain the store buffer. The store has release order, so that it
// cannot become visible before the lock. On ARM a relaxed store may overtake the store half of the
// compare-and-swap that took the lock. A reader would then validate a count too early.
template <class T>
void increment(std::atomic<T>& counter) noexcept {
  counter.store(counter.load(std::memory_order_relaxed) + 1, std::memory_order_release);
}

inline void store_latest(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
  frame.parent.store(parent, std::memory_order_release);
  frame.latest.stamp.store(stamp, std::memory_order_release);
  frame.latest.pose.store(pose);
}

// Leaves the frame without samples. Its parent stays for now: who holds the topology mutex may read
// it without the frame's lock. A sample must follow.
inline void drop_samples(Frame& frame) noexcept {
  frame.is_static.store(false, std::memory_order_release);
  frame.samples_per_ns.store(0, std::memory_order_release);
  frame.count.store(0, std::memory_order_release);
}

// Leaves the frame without samples and without a parent.
inline void clear_history(Frame& frame) noexcept {
  drop_samples(frame);
  frame.parent.store(0, std::memory_order_release);
}

// Replaces by 0 each past parent for which is_lost(id) is true. Requires that the newest sample's
// parent is not lost: then the parents still differ if one is replaced, and all that says so stays
// valid (records/frame.hpp, invariants 3 and 4). Returns whether the samples had several parents.
template <class IsLost>
bool forget_parents(Frame& frame, IsLost&& is_lost) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const std::uint32_t count = frame.count.load(relaxed), first = frame.first.load(relaxed);
  if (count == 0 || frame.parent_changes.load(relaxed) == 0) return false;
  const Ring ring = frame.ring.load(relaxed);
  std::uint32_t changes = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (is_lost(ring.parent(first + i))) ring.store_parent(first + i, 0);
    changes += i != 0 && ring.parent(first + i) != ring.parent(first + i - 1);
  }
  frame.parent_changes.store(changes, std::memory_order_release);
  return true;
}

// Replaces the frame's history by one transform for all times.
inline void set_static(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
  frame.samples_per_ns.store(0, std::memory_order_release);
  frame.count.store(0, std::memory_order_release);
  frame.is_static.store(true, std::memory_order_release);
  store_latest(frame, stamp, parent, pose);
}

// A frame's samples in a new ring, which the frame gets when the commit is applied. Then `ring` is
// the one that it replaced.
struct PreparedRing {
  Ring ring;
  // True if the ring holds all samples as they will be after the commit. Else it holds those that
  // the frame has now, in the same slots, and there is room for more.
  bool is_merged;
  // Of a merged ring: its samples from slot 0 on, how often their parent changes, the newest's
  // parent, and what happened to others.
  std::uint32_t count, parent_changes, evicted, rewritten;
  FrameId parent;
};

// A sample that a commit stores.
struct NewSample {
  Stamp stamp;
  FrameId parent;
  const Pose* pose;
};

// True if the frame's ring has no room for `extra` more samples, of which `kept` are there now.
// Requires the write lock.
inline bool needs_larger_ring(const Frame& frame, std::uint64_t kept, std::uint32_t extra,
                              const HistoryLimits& limits) noexcept {
  const Ring ring = frame.ring.load(std::memory_order_relaxed);
  const std::uint64_t wanted = std::min<std::uint64_t>(kept + extra, limits.max_samples);
  return !ring || ring.capacity() < wanted;
}

// Returns a larger ring with the frame's samples, with room for `extra` more. Requires the write
// lock; readers may continue. Throws RingArena::Full and bad_alloc.
PreparedRing grown_ring(const Frame& frame, std::uint32_t extra, const HistoryLimits& limits,
                        RingArena& memory);

// Returns a ring in which the new samples are merged with the frame's, or with none if `cleared`:
// as if they were inserted one by one, but in one pass. Requires the write lock, new samples by
// stamp (the last of equal ones wins), and that none is too old for the frame, nor older than all
// samples of a full one. Readers may continue. Throws RingArena::Full and bad_alloc.
PreparedRing merged_ring(const Frame& frame, bool cleared, std::span<const NewSample> samples,
                         const HistoryLimits& limits, RingArena& memory);

// Gives the frame the prepared ring, and sets `prepared.ring` to the one that it had, or to none.
void publish_ring(Frame& frame, PreparedRing& prepared) noexcept;

// True if samples from this stamp on should be merged instead of inserted: they are so late, and so
// many, that it costs less, or they would move so many samples that readers would wait for long.
// Requires the write lock.
bool should_merge(const Frame& frame, Stamp oldest_new, std::uint32_t samples) noexcept;

// Prefetches the slots that an insert of a newer sample stores to and reads. Requires no lock: if
// another writer interferes, the wrong lines are prefetched.
inline void prefetch_history(const Frame& frame) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const Ring ring = frame.ring.load(relaxed);
  if (!ring) return;
  const std::uint32_t first = frame.first.load(relaxed);
  ring.prefetch_for_write(first + frame.count.load(relaxed));
  ring.prefetch(first + 1);  // the oldest sample, once the insert has pruned the first
}

// A frame's samples during one insert: a copy of the words that say which slots are used. Sample i
// is the i-th oldest. The frame's own words change only in prune_and_publish().
class RingEdit {
 public:
  // Prepares the insert of a sample of this parent. The ring's parents are kept up to date only
  // while its samples have several; the first sample of a second parent fills them in.
  ZTF_ALWAYS_INLINE RingEdit(const Frame& frame, FrameId parent) noexcept
      : ring_(frame.ring.load(std::memory_order_relaxed)),
        first_(frame.first.load(std::memory_order_relaxed)),
        count_(frame.count.load(std::memory_order_relaxed)),
        oldest_(frame.oldest_stamp.load(std::memory_order_relaxed)),
        parent_changes_(count_ == 0 ? 0 : frame.parent_changes.load(std::memory_order_relaxed)) {
    const FrameId newest_parent = frame.parent.load(std::memory_order_relaxed);
    if (parent_changes_ == 0 && (count_ == 0 || newest_parent == parent)) return;
    has_parents_ = true;
    if (parent_changes_ == 0) fill_in_parents(ring_, first_, count_, newest_parent);
  }

  [[nodiscard]] std::uint32_t count() const noexcept { return count_; }
  [[nodiscard]] Stamp stamp(std::uint32_t i) const noexcept { return ring_.stamp(first_ + i); }
  // Returns the number of samples that are not newer than the stamp: its place.
  [[nodiscard]] std::uint32_t place_of(Stamp stamp) const noexcept {
    return find_place(ring_, first_, count_, stamp);
  }

  // Drops the oldest sample. If it is the only one, the caller must store() another next.
  ZTF_ALWAYS_INLINE void drop_oldest() noexcept {
    if (has_parents_) [[unlikely]]
      parent_changes_ -= changes_around(ring_, first_, count_, 0);
    ++first_;
    --count_;
    oldest_ = stamp(0);
  }
  // Frees slot `i` by moving all newer samples up by one. Requires a free slot in the ring.
  ZTF_ALWAYS_INLINE void open_slot(std::uint32_t i) noexcept {
    if (i != count_) [[unlikely]] {
      // The sample comes between i - 1 and i: store() counts the changes on both of its sides.
      if (has_parents_ && i > 0)
        parent_changes_ -= ring_.parent(first_ + i - 1) != ring_.parent(first_ + i);
      move_up(ring_, first_ + i, first_ + count_, has_parents_);
    }
    ++count_;
  }
  // Takes sample i out of the count of parent changes. Requires that store() replaces it next.
  void forget_parent(std::uint32_t i) noexcept {
    if (has_parents_) parent_changes_ -= changes_around(ring_, first_, count_, i);
  }
  // Stores sample i, and counts the changes of parent on both of its sides.
  ZTF_ALWAYS_INLINE void store(std::uint32_t i, Stamp stamp, FrameId parent,
                               const Pose& pose) noexcept {
    ring_.store(first_ + i, stamp, pose);
    if (i == 0) oldest_ = stamp;
    if (has_parents_) [[unlikely]] {
      ring_.store_parent(first_ + i, parent);
      parent_changes_ += changes_around(ring_, first_, count_, i);
    }
  }

  // Prunes the samples older than the cache time, and makes the rest the frame's samples. These are
  // the last stores of an insert.
  ZTF_ALWAYS_INLINE void prune_and_publish(Frame& frame, Stamp newest,
                                           std::uint64_t cache_ns) noexcept {
    if (too_old(oldest_, newest, cache_ns)) {
      drop_oldest();
      if (too_old(oldest_, newest, cache_ns)) [[unlikely]]
        drop_older(newest, cache_ns);
    }
    const auto release = std::memory_order_release;
    frame.is_static.store(false, release);
    frame.parent_changes.store(parent_changes_, release);
    frame.oldest_stamp.store(oldest_, release);
    frame.samples_per_ns.store(parent_changes_ == 0 ? mean_sample_rate(count_, oldest_, newest) : 0,
                               release);
    frame.first.store(first_, release);
    frame.count.store(count_, release);
  }

 private:
  // Drops all samples older than the cache time.
  void drop_older(Stamp newest, std::uint64_t cache_ns) noexcept {
    if (has_parents_) {
      while (too_old(oldest_, newest, cache_ns)) drop_oldest();
      return;
    }
    const std::uint32_t dropped = count_too_old(ring_, first_, count_, newest, cache_ns);
    first_ += dropped;
    count_ -= dropped;
    oldest_ = stamp(0);
  }

  // The rare parts. They are static, so that the members of a RingEdit can stay in registers.
  static std::uint32_t find_place(Ring ring, std::uint32_t first, std::uint32_t count,
                                  Stamp stamp) noexcept;
  static std::uint32_t count_too_old(Ring ring, std::uint32_t first, std::uint32_t count,
                                     Stamp newest, std::uint64_t cache_ns) noexcept;
  static void fill_in_parents(Ring ring, std::uint32_t first, std::uint32_t count,
                              FrameId parent) noexcept;
  // Moves the samples in the slots from `begin` up to `end` by one slot.
  static void move_up(Ring ring, std::uint32_t begin, std::uint32_t end,
                      bool with_parents) noexcept;
  // Returns how often the parent changes between sample i and its neighbours.
  static std::uint32_t changes_around(Ring ring, std::uint32_t first, std::uint32_t count,
                                      std::uint32_t i) noexcept;

  const Ring ring_;
  std::uint32_t first_, count_;
  Stamp oldest_;
  std::uint32_t parent_changes_;
  bool has_parents_ = false;  // the samples have several parents before or after this insert
};

// The slow path of insert(), for a sample that is not newer than all others.
InsertResult insert_late(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose,
                         const HistoryLimits& limits) noexcept;

// Inserts a sample by the rules above. Requires room in the ring, and that it is not too old.
inline InsertResult insert(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose,
                           const HistoryLimits& limits) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  if (frame.count.load(relaxed) != 0 && stamp <= frame.latest.stamp.load(relaxed)) [[unlikely]]
    return insert_late(frame, stamp, parent, pose, limits);
  RingEdit ring(frame, parent);
  if (ring.count() == limits.max_samples) {
    if (!too_old(ring.stamp(0), stamp, limits.cache_ns)) increment(frame.evicted);
    ring.drop_oldest();
  }
  const std::uint32_t end = ring.count();
  ring.open_slot(end);
  ring.store(end, stamp, parent, pose);
  store_latest(frame, stamp, parent, pose);
  ring.prune_and_publish(frame, stamp, limits.cache_ns);
  return InsertResult::added;
}

}  // namespace ztf
