// What is less usual about a history: samples that come at random times, or not as the newest, and
// the reasons why there is none.
#include "history.hpp"

namespace ztf {

namespace {

// Samples looked at beside a guess, before the next one: their loads overlap, those of guesses do
// not.
constexpr std::uint32_t kNear = 8;
constexpr int kGuesses = 12;

// The last sample not after the stamp, counted from `first`, which is not after it; the one at
// `high` is. Every guess starts from the sample of the guess before, at the history's mean rate:
// where samples come at random, that is off by the root of the distance. Then by halves.
std::uint32_t find(Ring ring, std::uint32_t first, std::uint32_t high, double rate, Stamp newest,
                   Stamp stamp) noexcept {
  std::uint32_t low = 0, at = high;
  Stamp from = newest;
  for (int i = 0; high - low > 1; ++i) {
    const double steps =
        from <= stamp ? distance(from, stamp) * rate : -distance(stamp, from) * rate;
    const double guess = i < kGuesses ? at + std::floor(steps) : low + (high - low) / 2;
    // In a collision with a writer the guess may be anything.
    at = !(guess > low) ? low + 1 : guess < high ? static_cast<std::uint32_t>(guess) : high - 1;
    from = ring.stamp(first + at);
    if (from <= stamp) {
      for (low = at; low + 1 < high && low < at + kNear; ++low)
        if ((from = ring.stamp(first + low + 1)) > stamp) return low;
      at = low;
    } else {
      for (high = at; low + 1 < high && high + kNear > at; --high)
        if ((from = ring.stamp(first + high - 1)) <= stamp) return high - 1;
      at = high;
    }
  }
  return low;
}

// How often the parent changes between a sample and its neighbours.
std::uint32_t changes_at(Ring ring, std::uint32_t first, std::uint32_t count,
                         std::uint32_t place) noexcept {
  const FrameId parent = ring.parent(first + place);
  return (place > 0 && ring.parent(first + place - 1) != parent) +
         (place + 1 < count && ring.parent(first + place + 1) != parent);
}

}  // namespace

LinkLookup search(const Frame& frame, Stamp stamp, SampleInterval& interval) noexcept {
  using Status = LinkLookup::Status;
  const auto acquire = std::memory_order_acquire;
  const FrameId parent = frame.parent.load(acquire);
  const std::uint32_t count = frame.count.load(acquire);
  const auto none = [&](Status why) {
    return newest_link(frame, why, why == Status::root ? 0 : parent, stamp, interval);
  };
  if (count == 0) return none(Status::root);
  const Stamp newest = frame.latest.stamp.load(acquire);
  if (count == 1) return none(Status::no_data);
  if (stamp > newest) return none(Status::forward);

  const Ring ring = frame.ring.load(acquire);
  const std::uint32_t first = frame.first.load(acquire);
  if (!ring) return none(Status::no_data);  // only in a collision with a writer
  const Stamp oldest = ring.stamp(first);
  if (stamp < oldest) return none(Status::backward);

  const double kept = frame.samples_per_ns.load(acquire);
  const double rate = kept > 0 ? kept : mean_sample_rate(count, oldest, newest);
  const std::uint32_t slot = first + find(ring, first, count - 1, rate, newest, stamp);
  const FrameId older = parent_at(frame, ring, slot);
  const FrameId newer = parent_at(frame, ring, slot + 1);
  interval = {&ring.sample(slot), &ring.sample(older == newer ? slot + 1 : slot), stamp};
  return {Status::ok, older};
}

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
