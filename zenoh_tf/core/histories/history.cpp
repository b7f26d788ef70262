// The slow path of finding samples: a search of the ring.
#include "histories/history.hpp"

namespace ztf {

namespace {

// Returns the number of the newest sample that is not after the time. Requires that sample 0 is not
// after it, and that sample `high`, whose stamp is `newest`, is.
//
// This is an interpolation search. Each guess starts from the last probe and applies the mean
// sample rate; with random stamps it misses by about the square root of the distance. Each probe
// also looks at its next kScan neighbours, whose loads overlap. After kGuesses it bisects.
std::uint32_t search_ring(Ring ring, std::uint32_t first, std::uint32_t high, double rate,
                          Stamp newest, Stamp time) noexcept {
  constexpr std::uint32_t kScan = 8;
  constexpr int kGuesses = 12;
  std::uint32_t low = 0, probe = high;
  Stamp stamp = newest;
  for (int guesses = 0; high - low > 1; ++guesses) {
    const double steps =
        stamp <= time ? elapsed_ns(stamp, time) * rate : -elapsed_ns(time, stamp) * rate;
    const double guess = guesses < kGuesses ? probe + std::floor(steps) : low + (high - low) / 2;
    // The comparisons clamp any guess between low and high, also NaN, which a torn read may cause.
    probe = !(guess > low) ? low + 1 : guess < high ? static_cast<std::uint32_t>(guess) : high - 1;
    stamp = ring.stamp(first + probe);
    if (stamp <= time) {
      for (low = probe; low + 1 < high && low < probe + kScan; ++low)
        if ((stamp = ring.stamp(first + low + 1)) > time) return low;
      probe = low;
    } else {
      for (high = probe; low + 1 < high && high + kScan > probe; --high)
        if ((stamp = ring.stamp(first + high - 1)) <= time) return high - 1;
      probe = high;
    }
  }
  return low;
}

}  // namespace

LinkLookup find_link_by_search(const Frame& frame, Ring ring, Stamp time,
                               SampleInterval& interval) noexcept {
  using Status = LinkLookup::Status;
  const auto acquire = std::memory_order_acquire;
  const FrameId parent = frame.parent.load(acquire);
  const std::uint32_t count = frame.count.load(acquire);
  const Stamp newest = frame.latest.stamp.load(acquire);
  interval = {&frame.latest, &frame.latest, time};
  if (count == 0) return {Status::root, 0};
  if (count == 1 || !ring) return {Status::no_data, parent};  // without a ring: a torn read
  if (time > newest) return {Status::forward, parent};

  const std::uint32_t first = frame.first.load(acquire);
  const Stamp oldest = ring.stamp(first);
  if (time < oldest) return {Status::backward, parent};

  const double known_rate = frame.samples_per_ns.load(acquire);
  const double rate = known_rate > 0 ? known_rate : mean_sample_rate(count, oldest, newest);
  const std::uint32_t slot = first + search_ring(ring, first, count - 1, rate, newest, time);
  const FrameId older = parent_at(frame, ring, slot);
  const FrameId newer = parent_at(frame, ring, slot + 1);
  interval = {&ring.sample(slot), &ring.sample(older == newer ? slot + 1 : slot), time};
  return {Status::ok, older};
}

}  // namespace ztf
