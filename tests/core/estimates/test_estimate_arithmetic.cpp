// The arithmetic of estimates: ranks, joint scores, twists, buckets of lags, limits of motion.
#include <numeric>

#include "estimates/backtest.hpp"
#include "estimates/limits.hpp"
#include "fixture.hpp"

using namespace ztf;

namespace {

Pose turned(double x, double y, double yaw) {
  return {x, y, 0, 0, 0, std::sin(yaw / 2), std::cos(yaw / 2)};
}

// Residuals 1, 2, ... n thousandths, each ten milliseconds older than the one before.
struct Series {
  explicit Series(std::size_t n) : residuals(n), age_s(n) {
    for (std::size_t i = 0; i < n; ++i) {
      residuals[i] = {1e-3 * static_cast<double>(i + 1), 2e-3 * static_cast<double>(i + 1)};
      age_s[i] = 0.01 * static_cast<double>(i);
    }
  }
  [[nodiscard]] ErrorBound::Value at(double level, double lag_s) const {
    return ErrorBound(residuals, age_s, 0.01 * static_cast<double>(age_s.size()), lag_s).at(level);
  }
  std::vector<Residual> residuals;
  std::vector<double> age_s;
};

}  // namespace

TEST(ranks_count_from_one) {
  std::vector<double> values{5, 3, 1, 4, 2};
  CHECK_EQ(kth_smallest(values, 1), 1);
  CHECK_EQ(kth_smallest(values, 5), 5);
  CHECK_EQ(quantile(values, 0.6), 3);
  CHECK_EQ(quantile(values, 0.61), 4);
  CHECK_EQ(quantile(values, 1), 5);
}

TEST(the_bound_is_the_conformal_quantile) {
  // 1,999 backtests in 20 s: the 0.9 quantile is the 1,800th, ceil(0.9 * 2,000). Errors only grow
  // with age, so the newest ones bound less.
  const ErrorBound::Value bound = Series(1999).at(0.9, 0);
  CHECK_NEAR(bound.metres, 1.8, 1e-12);
  CHECK_NEAR(bound.radians, 3.141592653589793, 1e-12);  // 3.6 is more than half a turn
  CHECK_EQ(bound.level, 0.9);
  CHECK_EQ(bound.backtests, 39);
}

TEST(the_newest_backtests_bound_by_themselves) {
  Series series(2000);
  std::reverse(series.residuals.begin(), series.residuals.end());
  // Of the last half second: the 47th of 51.
  CHECK_NEAR(series.at(0.9, 0).metres, 1.996, 1e-9);
}

TEST(a_level_needs_enough_backtests) {
  const ErrorBound::Value bound = Series(300).at(0.99, 0.5);  // 3 s: 6 independent ones
  CHECK_EQ(bound.backtests, 6);
  CHECK_NEAR(bound.level, 6.0 / 7, 1e-12);
  CHECK_NEAR(bound.metres, 0.3, 1e-12);  // the largest of all
  const ErrorBound::Value none = ErrorBound({}, {}, 0, 0.1).at(0.9);
  CHECK(std::isinf(none.metres) && std::isinf(none.radians));
  CHECK_EQ(none.level, 0);
}

TEST(one_error_that_used_to_be_zero_does_not_inflate_the_other) {
  std::vector<Residual> residuals(200, {1e-3, 0});
  std::vector<double> age_s(200);
  for (std::size_t i = 0; i < 200; ++i) age_s[i] = 0.05 * static_cast<double>(i);
  residuals[0] = {1e-3, 0.2};
  const ErrorBound::Value bound = ErrorBound(residuals, age_s, 10, 0).at(0.9);
  CHECK_NEAR(bound.radians, 0.2, 1e-12);
  CHECK_NEAR(bound.metres, 1e-2, 1e-12);
}

TEST(a_constant_twist_is_carried_on_exactly) {
  for (const double rate : {0.0, 1e-6, 0.02, 0.7, 3.0}) {
    const auto at = [&](double t) {  // a circle, or a line for 0
      return rate == 0 ? turned(2 * t, 0, 0)
                       : turned(2 / rate * std::sin(rate * t), 2 / rate * (1 - std::cos(rate * t)),
                                rate * t);
    };
    for (const double ratio : {0.0, 0.3, 1.0, 7.0})
      CHECK(distance(carry_on(at(0.2), at(0.3), ratio), at(0.3 + 0.1 * ratio)) < 1e-9);
  }
  const Pose a = some_pose(1), step = some_pose(2);
  CHECK(distance(carry_on(a, a * step, 1), a * step * step) < 1e-12);
  // So short a window would show nothing but noise.
  CHECK(distance(predict(Predictor::twist_1, a, some_pose(3), 1e6), a) == 0);
  CHECK(distance(predict(Predictor::twist_1, a, a, std::nan("")), a) == 0);
}

TEST(poses_are_compared_by_distance_and_angle) {
  const Residual r = residual_between(turned(1, 2, 0.5), turned(4, 6, 0.1));
  CHECK_NEAR(r.metres, 5, 1e-12);
  CHECK_NEAR(r.radians, 0.4, 1e-12);
  const Pose p = some_pose(4);
  const Pose same{p.x, p.y, p.z, -p.qx, -p.qy, -p.qz, -p.qw};
  CHECK_NEAR(residual_between(p, same).radians, 0, 1e-7);
}

TEST(lags_are_rounded_up_by_a_fifth_at_most) {
  CHECK_EQ(lag_bucket(0), 0u);
  CHECK_EQ(longest_lag(0u), 0);
  CHECK_EQ(lag_bucket(1), 1u);
  for (Stamp lag = 1'000'000; lag < 4'000'000'000; lag += lag / 7) {
    const Stamp longest = longest_lag(lag_bucket(lag));
    CHECK(longest >= lag && longest < lag * 1.19 + 1);
    CHECK_EQ(lag_bucket(longest), lag_bucket(lag));
  }
  CHECK(longest_lag(lag_bucket(std::numeric_limits<Stamp>::max())) > 0);
}
