// The errors that an estimate would have had at past instants.
//
// Thread safety: values; a Backtest is constant once it is made.
#pragma once

#include "estimates/bound.hpp"
#include "estimates/cases.hpp"

namespace ztf {

// Over more times the distance of two samples one would see nothing but their noise.
inline constexpr double kMostRatio = 100;

// Returns the pose that a predictor gives. Requires the pose before of that predictor, and the time
// from `last` by that from `before` to `last`.
inline Pose predict(Predictor predictor, const Pose& last, const Pose& before,
                    double ratio) noexcept {
  return predictor != Predictor::hold && ratio <= kMostRatio ? carry_on(before, last, ratio) : last;
}

struct Backtest {
  ErrorBound bound;
  std::vector<Predictor> predictors;  // of each link of the path
  std::vector<double> shares;         // metres that each link adds to the error
};

// Compares. `before` is what the last backtest of the question chose, or null: a predictor is
// replaced only by one that is clearly better.
Backtest backtest(const PathNow& path, const Cases& cases, const Backtest* before);

}  // namespace ztf
