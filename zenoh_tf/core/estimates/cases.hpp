// Past instants at which the question of an estimate has an answer by now, and the samples that it
// would have had then.
//
// Thread safety: Cases belong to one thread. What copy_cases() copies is meaningful only after the
// guard has validated it.
#pragma once

#include <vector>

#include "estimates/path.hpp"
#include "geometry/screw.hpp"

namespace ztf {

// Lags are rounded up to a quarter of an octave, so that the backtests of one question serve those
// that follow. Bucket 0 is that of links which were measured at the time.
std::uint32_t lag_bucket(Stamp lag) noexcept;
Stamp longest_lag(std::uint32_t bucket) noexcept;

// Backtests are made again when the history of all links has passed such a time.
constexpr Stamp kGrid = 100'000'000;  // ns
// The seconds of history that backtests for a level use at most: 10 for 0.9.
unsigned window_class(double level) noexcept;
double window_s(unsigned window) noexcept;
// The number of independent backtests in a span of time: those that are closer than the lag, or
// half a second, have the same causes.
double independent(double span_s, double lag_s) noexcept;
constexpr double kIndependent = 0.5;  // seconds

// One link at one instant.
struct Case {
  Pose truth, last;  // last: what the question would have had, to hold or to carry on
  std::array<Pose, kTwists> before;
  std::array<double, kTwists> ratios;  // the time from `last` by that from `before` to `last`
  Residual by_clock;  // how far the link went in the time by which its clock may be off
};

struct Cases {
  bool moved;                 // a link has another parent by now: read the path again
  double span_s;              // from the oldest instant to the newest
  std::vector<double> age_s;  // of each instant, before the newest; ascending
  std::vector<Case> cases;    // for each link that is not fixed, one for each instant

  [[nodiscard]] std::size_t size() const noexcept { return age_s.size(); }
};

// Returns the longest lag of the path's links, as rounded.
Stamp longest_lag(const PathNow& path) noexcept;
// Returns the newest time at which all links have samples, in steps of kGrid.
Stamp grid_of(const PathNow& path) noexcept;

namespace detail {

// The newest samples of a link that have this parent, up to one with another parent.
class SampleRun {
 public:
  template <class Access>
  SampleRun(const Access& access, const Frame& frame, FrameId parent) : ring_(access.ring(frame)) {
    const auto acquire = std::memory_order_acquire;
    if (frame.is_static.load(acquire) || !ring_) return;
    first_ = frame.first.load(acquire);
    std::uint32_t end = std::min(frame.count.load(acquire), ring_.capacity());
    if (frame.parent_changes.load(acquire) == 0) {
      if (frame.parent.load(acquire) == parent) size_ = end;
      return;
    }
    while (end > 0 && ring_.parent(first_ + end - 1) != parent) --end;
    while (size_ < end && ring_.parent(first_ + end - size_ - 1) == parent) ++size_;
    first_ += end - size_;
  }
  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }
  [[nodiscard]] Stamp stamp(std::uint32_t i) const noexcept { return ring_.stamp(first_ + i); }
  [[nodiscard]] Pose pose(std::uint32_t i) const noexcept {
    return ring_.sample(first_ + i).pose.load();
  }
  [[nodiscard]] Stamp newest() const noexcept { return stamp(size_ - 1); }

  // Returns the newest sample that is not after a time. Requires that `from` is not.
  [[nodiscard]] std::uint32_t last_at(Stamp time, std::uint32_t from) const noexcept {
    std::uint32_t step = 1;
    while (from + step < size_ && stamp(from + step) <= time) {
      from += step;
      step *= 2;
    }
    for (std::uint32_t high = std::min(from + step, size_); high - from > 1;) {
      const std::uint32_t middle = from + (high - from) / 2;
      (stamp(middle) <= time ? from : high) = middle;
    }
    return from;
  }
  // Returns the pose at a time from sample i up to the next one.
  [[nodiscard]] Pose pose_at(Stamp time, std::uint32_t i) const noexcept {
    if (i + 1 >= size_ || stamp(i) >= time) return pose(i);
    const double ratio = elapsed_ns(stamp(i), time) / elapsed_ns(stamp(i), stamp(i + 1));
    return interpolate(pose(i), pose(i + 1), ratio);
  }

 private:
  const Ring ring_;
  std::uint32_t first_ = 0, size_ = 0;
};

// Copies the cases of one link, from the oldest instant to the newest; `out` has the newest first.
// The sample that the question carries on is as old as its lag, but at most instants no sample is.
// So a link that is carried on is compared when its sample was that old, which is up to a period
// before the instant.
void copy_link_cases(const SampleRun& run, const LinkNow& link, std::span<const Stamp> times,
                     Case* out) noexcept;
// Chooses the instants, newest first, and sets their ages. Returns none if the history of all links
// is too short.
std::vector<Stamp> choose_times(std::span<const SampleRun> runs, const PathNow& path,
                                double window_s, Cases& cases);

}  // namespace detail

// Copies the cases of a path, with the instants in the last `window_s` of its history. Returns
// false if the transaction must be retried, like Reader's functions. Throws bad_alloc.
template <class AnyReader>
bool copy_cases(AnyReader& reader, const PathNow& path, double window_s, Cases& cases) {
  cases.moved = false;
  std::vector<detail::SampleRun> runs;
  for (const LinkNow& link : path.links) {
    const bool valid = reader.with_frame(link.child, [&](const Frame& frame) {
      if (link.kind != LinkNow::Kind::fixed) runs.emplace_back(reader.access(), frame, link.parent);
    });
    if (!valid) return false;
  }
  for (const detail::SampleRun& run : runs) cases.moved |= run.size() == 0;
  const std::vector<Stamp> times = detail::choose_times(runs, path, window_s, cases);
  cases.cases.resize(runs.size() * times.size());
  std::size_t i = 0;
  for (const LinkNow& link : path.links)
    if (link.kind != LinkNow::Kind::fixed) {
      detail::copy_link_cases(runs[i], link, times, cases.cases.data() + i * times.size());
      ++i;
    }
  return true;
}

}  // namespace ztf
