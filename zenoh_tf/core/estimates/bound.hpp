// Bounds of errors from those of backtests: split-conformal prediction.
//
// Among n errors and the next one each is as likely as any other to be the k-th smallest, if they
// are exchangeable. So the next one is at most the ceil((n + 1) level)-th smallest with at least
// that probability (Vovk et al., "Algorithmic Learning in a Random World").
//
// Thread safety: functions of their arguments; an ErrorBound is constant once it is made.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/screw.hpp"

namespace ztf {

// Returns the k-th smallest value, k from 1 to the number of values. Reorders the values.
double kth_smallest(std::span<double> values, std::size_t k) noexcept;
// Returns the value that a share of the values does not exceed. Requires at least one value, and
// reorders them.
double quantile(std::span<double> values, double share) noexcept;

// Beside all backtests the newest ones are ranked by themselves, and the larger bound counts: after
// a change of regime they know better.
double newest_window_s(double lag_s) noexcept;
// Returns how many of the ages, which ascend, are within a window.
std::size_t newest_within(std::span<const double> age_s, double window_s) noexcept;

// Both errors are bounded at once: the score of a backtest is the larger one of its errors, each in
// units of its own 0.9 quantile.
class ErrorBound {
 public:
  struct Value {
    double metres, radians;  // infinite if there was no backtest
    double level;
    std::int64_t backtests;
  };

  // Of backtests with these ages, newest first, over that span.
  ErrorBound(std::span<const Residual> residuals, std::span<const double> age_s, double span_s,
             double lag_s);

  [[nodiscard]] Value at(double level) const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept { return scores_.capacity() * sizeof(double); }

 private:
  // The newest backtests of a span of time: their scores are scores_[begin, begin + size).
  struct Window {
    std::size_t begin, size;
    // Those that do not overlap: they set the rank. independent() counts one in half a second at
    // most, so every bound would be at least the largest error of the newest window.
    double disjoint;
  };
  void add_window(std::span<const double> scores, std::size_t size, double span_s, double lag_s);

  double metres_ = 0, radians_ = 0;  // units of the score
  double independent_ = 0;           // independent() of all backtests: it limits the level
  std::vector<double> scores_;       // ascending in each window
  std::vector<Window> windows_;      // the first one is of all backtests
};

}  // namespace ztf
