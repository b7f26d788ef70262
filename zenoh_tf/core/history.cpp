// Samples from the ring, searched by time: irregular ones, and the reasons why there is none.
#include "history.hpp"

namespace ztf {

namespace {

constexpr int kGuesses = 12;

// The last sample not after the stamp, counted from `first`, which is not after it; the one at
// `high` is. Every guess starts from the sample of the guess before, at the history's mean rate:
// where samples come at random, that is off by the root of the distance. Then by halves.
std::uint32_t find(const Frame& frame, Ring ring, std::uint32_t first, std::uint32_t high,
                   Stamp newest, Stamp stamp) noexcept {
  const double rate = frame.samples_per_ns.load(std::memory_order_acquire);
  std::uint32_t low = 0, at = high;
  Stamp from = newest;
  for (int i = 0; high - low > 1; ++i) {
    const double steps = from <= stamp ? distance(from, stamp) * rate : -distance(stamp, from) * rate;
    const double guess = i < kGuesses ? at + std::floor(steps) : low + (high - low) / 2;
    // In a collision with a writer the guess may be anything.
    at = !(guess > low) ? low + 1 : guess < high ? static_cast<std::uint32_t>(guess) : high - 1;
    from = ring.stamp(first + at);
    (from <= stamp ? low : high) = at;
  }
  return low;
}

}  // namespace

Place search(const Frame& frame, Stamp stamp, Bracket& bracket) noexcept {
  using Kind = Place::Kind;
  const auto acquire = std::memory_order_acquire;
  const FrameId parent = frame.parent.load(acquire);
  const std::uint32_t count = frame.count.load(acquire);
  const auto none = [&](Kind why) {
    return at_newest(frame, why, why == Kind::root ? 0 : parent, stamp, bracket);
  };
  if (count == 0) return none(Kind::root);
  const Stamp newest = frame.latest.stamp.load(acquire);
  if (count == 1) return none(Kind::no_data);
  if (stamp > newest) return none(Kind::forward);

  const Ring ring = frame.ring.load(acquire);
  const std::uint32_t first = frame.first.load(acquire);
  if (!ring) return none(Kind::no_data);  // only in a collision with a writer
  const Stamp oldest = ring.stamp(first);
  if (stamp < oldest) return none(Kind::backward);

  const std::uint32_t slot = first + find(frame, ring, first, count - 1, newest, stamp);
  const FrameId older = parent_at(frame, ring, slot);
  const FrameId newer = parent_at(frame, ring, slot + 1);
  bracket = {&ring.sample(slot), &ring.sample(older == newer ? slot + 1 : slot), stamp};
  return {Kind::ok, older, slot & Place::kSlots};
}

}  // namespace ztf
