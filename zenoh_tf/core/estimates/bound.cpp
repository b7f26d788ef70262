// How scores are ranked.
#include "estimates/bound.hpp"

#include <algorithm>
#include <limits>

#include "estimates/cases.hpp"

namespace ztf {

namespace {

constexpr double kScale = 0.9;  // the quantile that is a score's unit
// A unit is at least this part of the largest error. So a score that is large because one of the
// errors used to be zero does not blow the other one up.
constexpr double kLeastScale = 0.1;
constexpr double kZero = 1e-9;  // metres, radians
constexpr double kRecent = 10;  // seconds: a window between the newest and all

// Ranks that are whole numbers must not be rounded up.
std::size_t rank_of(double share, std::size_t n) noexcept {
  const double rank = std::ceil(share * static_cast<double>(n) - 1e-9);
  return std::clamp<std::size_t>(static_cast<std::size_t>(std::max(rank, 1.0)), 1, n);
}

double unit_of(std::vector<double>& errors) noexcept {
  const double largest = *std::max_element(errors.begin(), errors.end());
  return std::max({quantile(errors, kScale), kLeastScale * largest, kZero});
}

}  // namespace

double kth_smallest(std::span<double> values, std::size_t k) noexcept {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(k - 1);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double quantile(std::span<double> values, double share) noexcept {
  return kth_smallest(values, rank_of(share, values.size()));
}

double newest_window_s(double lag_s) noexcept { return std::max(0.5, 2 * lag_s); }

std::size_t newest_within(std::span<const double> age_s, double window_s) noexcept {
  return static_cast<std::size_t>(std::upper_bound(age_s.begin(), age_s.end(), window_s) -
                                  age_s.begin());
}

ErrorBound::ErrorBound(std::span<const Residual> residuals, std::span<const double> age_s,
                       double span_s, double lag_s)
    : independent_(independent(span_s, lag_s)) {
  if (residuals.empty()) return;
  std::vector<double> values(residuals.size());
  const auto each = [&](auto&& value) {
    std::transform(residuals.begin(), residuals.end(), values.begin(), value);
  };
  each([](const Residual& r) { return r.metres; });
  metres_ = unit_of(values);
  each([](const Residual& r) { return r.radians; });
  radians_ = unit_of(values);
  each([&](const Residual& r) { return std::max(r.metres / metres_, r.radians / radians_); });

  scores_.reserve(2 * values.size());
  add_window(values, values.size(), span_s, lag_s);
  for (const double window : {kRecent, newest_window_s(lag_s)}) {
    const std::size_t size = newest_within(age_s, window);
    // None is left where a gap fills the window.
    if (size > 0 && size < values.size()) add_window(values, size, window, lag_s);
  }
}

void ErrorBound::add_window(std::span<const double> scores, std::size_t size, double span_s,
                            double lag_s) {
  const double n = static_cast<double>(size);
  windows_.push_back({scores_.size(), size, lag_s > 0 ? std::min(n, span_s / lag_s) : n});
  scores_.insert(scores_.end(), scores.begin(), scores.begin() + static_cast<std::ptrdiff_t>(size));
  std::sort(scores_.end() - static_cast<std::ptrdiff_t>(size), scores_.end());
}

ErrorBound::Value ErrorBound::at(double level) const noexcept {
  constexpr double infinite = std::numeric_limits<double>::infinity();
  if (windows_.empty()) return {infinite, infinite, 0, 0};
  const double most = independent_ / (independent_ + 1);
  double score = 0;
  for (const Window& w : windows_) {
    const double share = level > most ? 1 : level * (w.disjoint + 1) / w.disjoint;
    const std::size_t rank = rank_of(std::min(share, 1.0), w.size);
    score = std::max(score, scores_[w.begin + rank - 1]);
  }
  return {score * metres_, std::min(score * radians_, 3.141592653589793), std::min(level, most),
          static_cast<std::int64_t>(independent_)};
}

}  // namespace ztf
