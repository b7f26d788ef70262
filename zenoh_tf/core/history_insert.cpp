// Putting a sample at its place among older and newer ones.
#include "history_insert.hpp"

namespace ztf {

namespace {

// How often the parent changes between a sample and its neighbours.
std::uint32_t changes_at(Ring ring, std::uint32_t first, std::uint32_t count,
                         std::uint32_t place) noexcept {
  const FrameId parent = ring.parent(first + place);
  return (place > 0 && ring.parent(first + place - 1) != parent) +
         (place + 1 < count && ring.parent(first + place + 1) != parent);
}

}  // namespace

InsertResult insert_out_of_order(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose,
                                 const HistoryLimits& limits) noexcept {
  const auto relaxed = std::memory_order_relaxed;  // the writer's own words
  const auto release = std::memory_order_release;
  const Ring ring = frame.ring.load(relaxed);
  std::uint32_t first = frame.first.load(relaxed);
  std::uint32_t count = frame.count.load(relaxed);
  std::uint32_t changes = count == 0 ? 0 : frame.parent_changes.load(relaxed);
  const bool one_parent = changes == 0 && (count == 0 || frame.parent.load(relaxed) == parent);
  if (!one_parent && changes == 0)  // so far nobody has asked for them
    for (std::uint32_t i = 0; i < count; ++i)
      ring.store_parent(first + i, frame.parent.load(relaxed));
  bool is_rewritten = false, is_evicted = false;
  frame.is_static.store(false, release);

  // Mostly it is the newest. Else back to its place.
  const Stamp newest_before = frame.latest.stamp.load(relaxed);
  const bool is_newest = count == 0 || stamp > newest_before;
  std::uint32_t place = count;
  while (!is_newest && place > 0 && ring.stamp(first + place - 1) > stamp) --place;
  if (!is_newest && place > 0 && ring.stamp(first + place - 1) == stamp) {
    --place;
    if (!one_parent) changes -= changes_at(ring, first, count, place);
    is_rewritten = true;
  } else {
    if (count == limits.max_samples) {
      if (place == 0) return InsertResult::rejected;
      if (!one_parent) changes -= changes_at(ring, first, count, 0);
      ++first;
      --count;
      --place;
      is_evicted = true;
      increment(frame.evicted);
    }
    if (!one_parent && place > 0 && place < count)
      changes -= ring.parent(first + place - 1) != ring.parent(first + place);
    for (std::uint32_t i = count; i > place; --i) ring.copy(first + i, ring, first + i - 1);
    ++count;
  }
  ring.store(first + place, stamp, pose);
  if (!one_parent) {
    ring.store_parent(first + place, parent);
    changes += changes_at(ring, first, count, place);
  }
  if (place == count - 1) store_latest(frame, stamp, parent, pose);

  const Stamp newest = place == count - 1 ? stamp : newest_before;
  Stamp oldest = place == 0   ? stamp
                 : is_evicted ? ring.stamp(first)
                              : frame.oldest_stamp.load(relaxed);
  while (too_old(oldest, newest, limits.cache_ns)) {
    if (!one_parent) changes -= changes_at(ring, first, count, 0);
    ++first;
    --count;
    oldest = ring.stamp(first);
  }
  frame.parent_changes.store(changes, release);
  publish_range(frame, first, count, oldest,
                changes == 0 ? mean_sample_rate(count, oldest, newest) : 0);
  return is_rewritten ? InsertResult::replaced : InsertResult::added;
}

}  // namespace ztf
