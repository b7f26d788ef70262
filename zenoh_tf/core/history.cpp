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

}  // namespace ztf
