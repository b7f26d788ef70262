// Samples from the ring: searched by time, interpolated.
#include "history.hpp"

namespace ztf {

Place search(const Frame& frame, Stamp stamp) noexcept {
  using Kind = Place::Kind;
  const auto acquire = std::memory_order_acquire;
  const FrameId parent = frame.parent.load(acquire);
  const std::uint32_t count = frame.count.load(acquire);
  if (count == 0) return {Kind::root, 0, 0};
  const Stamp newest = frame.latest_stamp.load(acquire);
  if (count == 1) return {Kind::no_data, parent, 0};
  if (stamp > newest) return {Kind::forward, parent, 0};

  const Ring* ring = frame.ring.load(acquire);
  const std::uint32_t first = frame.first.load(acquire);
  if (!ring) return {Kind::no_data, parent, 0};  // only in a collision with a writer
  std::uint32_t low = 0, high = count - 1;       // stamp(low) <= stamp < stamp(high)
  Stamp low_stamp = ring->stamp(first), high_stamp = newest;
  if (stamp < low_stamp) return {Kind::backward, parent, 0};
  // Sensors are regular: guess by proportion, then halve, should they not be.
  for (int guesses = 0; high - low > 1; ++guesses) {
    std::uint32_t middle = low + (high - low) / 2;
    if (guesses < 4) {
      const double share = static_cast<double>(span_ns(low_stamp, stamp)) /
                           static_cast<double>(span_ns(low_stamp, high_stamp));
      const double guess = share * (high - low);  // may be anything in a collision
      middle = guess >= 1.0 && guess < high - low ? low + static_cast<std::uint32_t>(guess) : low + 1;
    }
    const Stamp middle_stamp = ring->stamp(first + middle);
    if (middle_stamp <= stamp) {
      low = middle;
      low_stamp = middle_stamp;
    } else {
      high = middle;
      high_stamp = middle_stamp;
    }
  }
  // Indices count on for ever and are masked; kNewest must not be one of them.
  return {Kind::ok, ring->parent(first + low), (first + low) & (Place::kNewest >> 1)};
}

Pose pose_between(const Frame& frame, std::uint32_t slot, Stamp stamp) noexcept {
  const Ring* ring = frame.ring.load(std::memory_order_acquire);
  if (!ring) return {};  // only in a collision with a writer
  const Stamp older = ring->stamp(slot), newer = ring->stamp(slot + 1);
  if (older == stamp || ring->parent(slot) != ring->parent(slot + 1)) return ring->pose(slot);
  const double ratio =
      static_cast<double>(span_ns(older, stamp)) / static_cast<double>(span_ns(older, newer));
  return interpolate(ring->pose(slot), ring->pose(slot + 1), ratio);
}

}  // namespace ztf
