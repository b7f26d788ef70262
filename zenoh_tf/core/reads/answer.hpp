// Parts of answers that need no reader: codes of failures, and stamps.
//
// Thread safety: functions of their arguments.
#pragma once

#include <algorithm>
#include <limits>

#include "reads/query.hpp"
#include "reads/walk.hpp"

namespace ztf {

// The oldest and the newest of some links' stamps; static links have none.
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

inline Code code_of(LinkLookup::Status status) noexcept {
  switch (status) {
    case LinkLookup::Status::no_data:
      return Code::no_data;
    case LinkLookup::Status::backward:
      return Code::backward;
    case LinkLookup::Status::forward:
      return Code::forward;
    default:
      return Code::extrapolation;
  }
}

// Returns the range of the newest links' stamps. Requires a chain of SelectLatest.
inline StampRange stamps_of(const Chain& chain) noexcept {
  StampRange stamps;
  for (const PathStep& step : chain.source) stamps.include(step.interval.time);
  for (const PathStep& step : chain.target) stamps.include(step.interval.time);
  return stamps;
}

// Returns 0 if all links are static, because any time serves then.
inline Stamp oldest_or_zero(const StampRange& stamps) noexcept {
  return stamps.empty() ? 0 : stamps.oldest();
}
inline void set_stamps(const StampRange& stamps, Answer& a) noexcept {
  a.stamp = oldest_or_zero(stamps);
  a.newest = stamps.empty() ? 0 : stamps.newest();
}

}  // namespace ztf
