// The slow paths of inserting: a larger ring, a late sample, a second parent.
#include "histories/insert.hpp"

#include <vector>

namespace ztf {

namespace {

constexpr std::uint32_t kFirstCapacity = 4;

// Returns a capacity for that many samples, and at least that of the ring.
std::uint32_t capacity_for(Ring ring, std::uint64_t samples) noexcept {
  std::uint32_t capacity = ring ? std::max(ring.capacity(), kFirstCapacity) : kFirstCapacity;
  while (capacity < samples) capacity *= 2;
  return capacity;
}

// Returns how many of the indices from 0 on, and below `count`, have the property. Requires that
// none has it after one that has not.
template <class Has>
std::uint32_t count_before(std::uint32_t count, Has&& has) noexcept {
  std::uint32_t low = 0, high = count;
  while (low < high) {
    const std::uint32_t middle = low + (high - low) / 2;
    if (has(middle))
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

}  // namespace

PreparedRing grown_ring(const Frame& frame, std::uint32_t extra, const HistoryLimits& limits,
                        RingArena& memory) {
  const auto relaxed = std::memory_order_relaxed;
  const Ring ring = frame.ring.load(relaxed);
  const std::uint32_t first = frame.first.load(relaxed), count = frame.count.load(relaxed);
  const std::uint64_t wanted =
      std::min<std::uint64_t>(std::uint64_t{count} + extra, limits.max_samples);
  PreparedRing prepared{Ring::make(capacity_for(ring, wanted), memory), false, 0, 0, 0, 0, 0};
  const bool has_parents = frame.parent_changes.load(relaxed) != 0;
  for (std::uint32_t i = first; i != first + count; ++i) {
    prepared.ring.copy(i, ring, i);
    if (has_parents) prepared.ring.store_parent(i, ring.parent(i));
  }
  return prepared;
}

PreparedRing merged_ring(const Frame& frame, bool cleared, std::span<const NewSample> samples,
                         const HistoryLimits& limits, RingArena& memory) {
  const auto relaxed = std::memory_order_relaxed;
  const Ring old = frame.ring.load(relaxed);
  const std::uint32_t first = frame.first.load(relaxed);
  const std::uint32_t count = cleared ? 0 : frame.count.load(relaxed);

  // Two passes over the same merge: the first counts, so that the second stores only what stays.
  const auto merge = [&](auto&& visit) {
    for (std::uint32_t i = 0, j = 0; i < count || j < samples.size();) {
      const bool takes_new =
          j < samples.size() && (i == count || samples[j].stamp <= old.stamp(first + i));
      const Stamp stamp = takes_new ? samples[j].stamp : old.stamp(first + i);
      std::uint32_t same = 0;
      if (i < count && old.stamp(first + i) == stamp) ++same;
      const std::uint32_t kept = i;
      i += same;
      while (j < samples.size() && samples[j].stamp == stamp) ++j, ++same;
      visit(stamp, takes_new ? &samples[j - 1] : nullptr, kept, same - 1);
    }
  };
  PreparedRing prepared{Ring(), true, 0, 0, 0, 0, 0};
  std::vector<Stamp> stamps;
  stamps.reserve(count + samples.size());
  merge([&](Stamp stamp, const NewSample*, std::uint32_t, std::uint32_t replaced) {
    stamps.push_back(stamp);
    prepared.rewritten += replaced;
  });
  // Drops the oldest samples as the inserts would one by one, so that `evicted` is the same.
  const Stamp newest_before = count != 0 ? frame.latest.stamp.load(relaxed) : stamps.front();
  std::uint32_t begin = 0;  // the oldest sample that stays
  for (std::uint32_t end = 0; end < stamps.size(); ++end) {
    const Stamp newest = std::max(stamps[end], newest_before);
    while (too_old(stamps[begin], newest, limits.cache_ns)) ++begin;
    if (end - begin < limits.max_samples) continue;
    ++begin;
    ++prepared.evicted;
  }
  prepared.count = static_cast<std::uint32_t>(stamps.size()) - begin;
  prepared.ring = Ring::make(capacity_for(old, prepared.count), memory);

  const bool had_parents = frame.parent_changes.load(relaxed) != 0;
  std::uint32_t seen = 0, stored = 0;
  merge([&](Stamp stamp, const NewSample* sample, std::uint32_t kept, std::uint32_t) {
    if (seen++ < begin) return;
    const FrameId parent = sample        ? sample->parent
                           : had_parents ? old.parent(first + kept)
                                         : frame.parent.load(relaxed);
    if (sample)
      prepared.ring.store(stored, stamp, *sample->pose);
    else
      prepared.ring.copy(stored, old, first + kept);
    prepared.ring.store_parent(stored, parent);
    prepared.parent_changes += stored != 0 && parent != prepared.parent;
    prepared.parent = parent;
    ++stored;
  });
  return prepared;
}

void publish_ring(Frame& frame, PreparedRing& prepared) noexcept {
  const auto release = std::memory_order_release;
  const Ring ring = prepared.ring;
  prepared.ring = frame.ring.load(std::memory_order_relaxed);
  frame.ring.store(ring, release);
  if (!prepared.is_merged) return;
  const std::uint32_t last = prepared.count - 1;
  const Stamp oldest = ring.stamp(0), newest = ring.stamp(last);
  store_latest(frame, newest, prepared.parent, ring.sample(last).pose.load());
  frame.is_static.store(false, release);
  frame.parent_changes.store(prepared.parent_changes, release);
  frame.oldest_stamp.store(oldest, release);
  frame.samples_per_ns.store(
      prepared.parent_changes == 0 ? mean_sample_rate(prepared.count, oldest, newest) : 0, release);
  frame.first.store(0, release);
  frame.count.store(prepared.count, release);
  frame.evicted.store(frame.evicted.load(std::memory_order_relaxed) + prepared.evicted, release);
}

bool should_merge(const Frame& frame, Stamp oldest_new, std::uint32_t samples) noexcept {
  constexpr std::uint64_t kMoves = 4;  // inserting may move so many samples for each one merged
  // Readers wait for about 7 us while so many samples are moved. They do not wait for a merge,
  // which may cost the writer kMoves times as much.
  constexpr std::uint64_t kLongMove = 1024;
  const auto relaxed = std::memory_order_relaxed;
  const std::uint32_t count = frame.count.load(relaxed);
  if (samples == 0 || count == 0 || oldest_new > frame.latest.stamp.load(relaxed)) return false;
  const Ring ring = frame.ring.load(relaxed);
  const std::uint32_t first = frame.first.load(relaxed);
  const std::uint32_t place =
      count_before(count, [&](std::uint32_t i) { return ring.stamp(first + i) <= oldest_new; });
  const std::uint64_t moved = count - place;
  if (samples == 1 && place > 0 && ring.stamp(first + place - 1) == oldest_new) return false;
  if (moved > kLongMove && moved * kMoves >= count) return true;
  return moved * samples > kMoves * (std::uint64_t{count} + samples);
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
  constexpr std::uint32_t kFew = 16;
  std::uint32_t place = count;
  const std::uint32_t end = count - std::min(count, kFew);
  while (place > end && ring.stamp(first + place - 1) > stamp) --place;
  if (place > end) return place;
  return count_before(end, [&](std::uint32_t i) { return ring.stamp(first + i) <= stamp; });
}

std::uint32_t RingEdit::count_too_old(Ring ring, std::uint32_t first, std::uint32_t count,
                                      Stamp newest, std::uint64_t cache_ns) noexcept {
  return count_before(
      count, [&](std::uint32_t i) { return too_old(ring.stamp(first + i), newest, cache_ns); });
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
