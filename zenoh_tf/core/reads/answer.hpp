// Parts of answers that need no reader: codes of failures, and stamps.
//
// Thread safety: functions of their arguments.
#pragma once

#include "reads/query.hpp"
#include "reads/stamp_range.hpp"
#include "reads/walk.hpp"

namespace ztf {

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
