// The oldest and the newest of some links' stamps.
//
// Thread safety: a value.
// Invariant: static links serve all times and do not count; their stamp is given as kNoStamp.
#pragma once

#include <algorithm>
#include <limits>

#include "base/stamp.hpp"

namespace ztf {

class StampRange {
 public:
  void include(Stamp stamp) noexcept {
    if (stamp == kNoStamp) return;
    oldest_ = std::min(oldest_, stamp);
    newest_ = std::max(newest_, stamp);
  }
  // True if no stamp was included; then oldest() and newest() are unspecified.
  [[nodiscard]] bool empty() const noexcept { return newest_ == kNoStamp; }
  [[nodiscard]] Stamp oldest() const noexcept { return oldest_; }
  [[nodiscard]] Stamp newest() const noexcept { return newest_; }
  // True if all included stamps are equal, or none was included.
  [[nodiscard]] bool all_equal() const noexcept { return oldest_ >= newest_; }

 private:
  Stamp oldest_ = std::numeric_limits<Stamp>::max();
  Stamp newest_ = kNoStamp;
};

}  // namespace ztf
