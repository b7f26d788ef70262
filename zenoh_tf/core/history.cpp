// Samples from the ring, searched by time: irregular ones, and the reasons why there is none.
#include "history.hpp"

namespace ztf {

namespace {

constexpr std::uint32_t kSteps = 8;

}  // namespace

Place search(const Frame& frame, Stamp stamp) noexcept {
  using Kind = Place::Kind;
  const auto acquire = std::memory_order_acquire;
  const FrameId parent = frame.parent.load(acquire);
  const std::uint32_t count = frame.count.load(acquire);
  if (count == 0) return {Kind::root, 0, 0};
  const Stamp newest = frame.latest_stamp.load(acquire);
  if (count == 1) return {Kind::no_data, parent, 0};
  if (stamp > newest) return {Kind::forward, parent, 0};

  const Ring ring = frame.ring.load(acquire);
  const std::uint32_t first = frame.first.load(acquire);
  if (!ring) return {Kind::no_data, parent, 0};  // only in a collision with a writer
  const Stamp oldest = ring.stamp(first);
  if (stamp < oldest) return {Kind::backward, parent, 0};

  // Around the place that place_at() guesses; then by halves. In a collision the
  // guess may be anything.
  std::uint32_t low = 0, high = count - 1;  // stamp(low) <= stamp < stamp(high)
  const double guess = share(oldest, stamp, newest) * high;
  const std::uint32_t near =
      guess >= 1.0 && guess < high ? static_cast<std::uint32_t>(guess) : low;
  if (ring.stamp(first + near) <= stamp) {
    low = near;
    for (std::uint32_t i = near + 1; i < high && i <= near + kSteps; ++i) {
      if (ring.stamp(first + i) > stamp)
        high = i;
      else
        low = i;
    }
  } else {
    high = near;
    for (std::uint32_t i = near; i-- > low && i + kSteps >= near;) {
      if (ring.stamp(first + i) <= stamp)
        low = i;
      else
        high = i;
    }
  }
  while (high - low > 1) {
    const std::uint32_t middle = low + (high - low) / 2;
    if (ring.stamp(first + middle) <= stamp)
      low = middle;
    else
      high = middle;
  }
  return {Kind::ok, ring.parent(first + low), (first + low) & Place::kSlots};
}

}  // namespace ztf
