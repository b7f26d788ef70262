// Gaps: intervals between two samples that are much longer than the link's period. A pose that is
// interpolated over one is a guess, and its answer says so.
//
// Thread safety: any reader may call these functions at any time (histories/history.hpp).
#pragma once

#include "geometry/pose4.hpp"
#include "histories/history.hpp"

namespace ztf {

// A gap is longer than so many of the link's periods. The period is the mean of the other intervals
// of its history; as long as there is none, a gap is longer than kLongestUnknown.
inline constexpr double kGapPeriods = 5;
inline constexpr double kLongestUnknown = 1e9;  // ns

// Limits of the time between two samples to interpolate over: any, or what is no gap.
inline constexpr Stamp kNoGapLimit = -1, kNoGaps = -2;

// Returns whether an interval is a gap in a history of `count` samples, which spans `whole`
// nanoseconds. Requires two samples.
inline bool is_gap(double interval, double whole, std::uint32_t count) noexcept {
  return interval * (count - 2) > kGapPeriods * (whole - interval);
}

// Returns whether an interval of the frame's history, of that many nanoseconds, is a gap.
[[gnu::noinline]] inline bool is_gap(const Frame& frame, double interval) noexcept {
  const auto acquire = std::memory_order_acquire;
  const std::uint32_t count = frame.count.load(acquire);
  if (count < 3) return interval > kLongestUnknown;
  const double whole =
      elapsed_ns(frame.oldest_stamp.load(acquire), frame.latest.stamp.load(acquire));
  return is_gap(interval, whole, count);
}

// Every gap is longer than kSuspectPeriods by this rate: the mean one, and a least one for
// histories that are short, slow or of two parents. It sorts out the common case, which has no gap.
inline constexpr double kSuspectPeriods = 1.6;
ZTF_ALWAYS_INLINE double rate_for_gaps(const Frame& frame) noexcept {
  constexpr double kLeast = kSuspectPeriods / kLongestUnknown;
  return std::max(frame.samples_per_ns.load(std::memory_order_acquire), kLeast);
}

// Returns whether an interval of the frame's history is longer than the limit allows.
inline bool exceeds(const Frame& frame, Stamp interval, Stamp limit) noexcept {
  if (limit == kNoGaps) return is_gap(frame, static_cast<double>(interval));
  return limit != kNoGapLimit && interval > limit;
}

// Returns the nanoseconds between the samples that a pose is interpolated between; 0 if a sample
// alone gives it.
inline Stamp interpolated_ns(const SampleInterval& interval) noexcept {
  const auto acquire = std::memory_order_acquire;
  const Stamp older = interval.older->stamp.load(acquire);
  if (interval.older == interval.newer || interval.time == older) return 0;
  constexpr std::uint64_t most = std::numeric_limits<Stamp>::max();
  return static_cast<Stamp>(std::min(span_ns(older, interval.newer->stamp.load(acquire)), most));
}

}  // namespace ztf
