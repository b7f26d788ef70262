// The rare parts of an insert: a larger ring, a sample among older and newer ones, a second parent.
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

std::uint32_t RingEdit::place_of(Stamp stamp) const noexcept {
  // From the newest on: late samples are mostly late by a few.
  std::uint32_t place = count_;
  while (place > 0 && this->stamp(place - 1) > stamp) --place;
  return place;
}

void RingEdit::fill_in_parents(FrameId parent) const noexcept {
  for (std::uint32_t i = 0; i < count_; ++i) ring_.store_parent(first_ + i, parent);
}

void RingEdit::move_up(std::uint32_t i) noexcept {
  // The new sample comes between i - 1 and i: store() counts the changes on both of its sides.
  if (has_parents_ && i > 0)
    parent_changes_ -= ring_.parent(first_ + i - 1) != ring_.parent(first_ + i);
  for (std::uint32_t to = first_ + count_; to != first_ + i; --to) {
    ring_.copy(to, ring_, to - 1);
    if (has_parents_) ring_.store_parent(to, ring_.parent(to - 1));
  }
}

std::uint32_t RingEdit::changes_around(std::uint32_t i) const noexcept {
  const FrameId parent = ring_.parent(first_ + i);
  return (i > 0 && ring_.parent(first_ + i - 1) != parent) +
         (i + 1 < count_ && ring_.parent(first_ + i + 1) != parent);
}

}  // namespace ztf
