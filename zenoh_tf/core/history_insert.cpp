// The slow paths of inserting: a larger ring, a late sample, a second parent.
#include "history_insert.hpp"

namespace ztf {

void grow_ring(Frame& frame, std::uint64_t wanted, RingArena& memory) {
  const auto relaxed = std::memory_order_relaxed;
  const Ring ring = frame.ring.load(relaxed);
  std::uint32_t capacity = ring ? ring.capacity() : 4;
  while (capacity < wanted) capacity *= 2;
  const Ring bigger = Ring::make(capacity, memory);
  const std::uint32_t first = frame.first.load(relaxed), count = frame.count.load(relaxed);
  const bool has_parents = frame.parent_changes.load(relaxed) != 0;
  for (std::uint32_t i = first; i != first + count; ++i) {
    bigger.copy(i, ring, i);
    if (has_parents) bigger.store_parent(i, ring.parent(i));
  }
  frame.ring.store(bigger, std::memory_order_release);
}

InsertResult insert_late(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose,
                         const HistoryLimits& limits) noexcept {
  const Stamp newest = frame.latest.stamp.load(std::memory_order_relaxed);
  RingEdit ring(frame, parent);
  std::uint32_t place = ring.place_of(stamp);
  const bool replaces = place > 0 && ring.stamp(place - 1) == stamp;
  if (replaces) {
    ring.forget_parent(--place);
  } else {
    if (ring.count() == limits.max_samples) {
      if (place == 0) return InsertResult::rejected;
      ring.drop_oldest();
      --place;
      increment(frame.evicted);
    }
    ring.open_slot(place);
  }
  ring.store(place, stamp, parent, pose);
  if (stamp == newest) store_latest(frame, stamp, parent, pose);
  ring.prune_and_publish(frame, newest, limits.cache_ns);
  return replaces ? InsertResult::replaced : InsertResult::added;
}

std::uint32_t RingEdit::find_place(Ring ring, std::uint32_t first, std::uint32_t count,
                                   Stamp stamp) noexcept {
  // Starts at the newest sample, as most late samples are newer than all but a few.
  std::uint32_t place = count;
  while (place > 0 && ring.stamp(first + place - 1) > stamp) --place;
  return place;
}

void RingEdit::fill_in_parents(Ring ring, std::uint32_t first, std::uint32_t count,
                               FrameId parent) noexcept {
  for (std::uint32_t i = 0; i < count; ++i) ring.store_parent(first + i, parent);
}

void RingEdit::move_up(Ring ring, std::uint32_t begin, std::uint32_t end,
                       bool with_parents) noexcept {
  for (std::uint32_t to = end; to != begin; --to) {
    ring.copy(to, ring, to - 1);
    if (with_parents) ring.store_parent(to, ring.parent(to - 1));
  }
}

std::uint32_t RingEdit::changes_around(Ring ring, std::uint32_t first, std::uint32_t count,
                                       std::uint32_t i) noexcept {
  const FrameId parent = ring.parent(first + i);
  return (i > 0 && ring.parent(first + i - 1) != parent) +
         (i + 1 < count && ring.parent(first + i + 1) != parent);
}

}  // namespace ztf
