// Interpolated rotations, of every angle, beside long double.
#include "fixture.hpp"
#include "geometry/pose4.hpp"

using namespace ztf;

namespace {

// A rotation by so much around the axis (2, 3, 6) / 7.
Pose turned(double angle) {
  const double sine = std::sin(angle / 2) / 7;
  return {0, 0, 0, 2 * sine, 3 * sine, 6 * sine, std::cos(angle / 2)};
}

double off(const Pose& a, const Pose& b) {
  return std::max(
      {std::abs(a.qx - b.qx), std::abs(a.qy - b.qy), std::abs(a.qz - b.qz), std::abs(a.qw - b.qw)});
}

constexpr double kRatios[] = {0, 1e-9, 0.1, 1.0 / 3, 0.5, 0.9, 1 - 1e-9, 1};

}  // namespace

TEST(a_rotation_is_interpolated_along_its_arc) {
  for (double angle = 1e-7; angle < 3.14; angle *= 1.01)
    for (const double ratio : kRatios) {
      const Pose found = interpolate(turned(0.3), turned(0.3 + angle), ratio);
      CHECK_NEAR(off(found, turned(0.3 + ratio * angle)), 0, 2e-14);
      // The same rotation by the other quaternion.
      Pose other = turned(0.3 + angle);
      for (double Pose::* c : {&Pose::qx, &Pose::qy, &Pose::qz, &Pose::qw}) other.*c = -(other.*c);
      CHECK_NEAR(off(interpolate(turned(0.3), other, ratio), found), 0, 2e-14);
    }
}

TEST(slerps_weights_are_those_of_its_formula) {
  for (double versine = 1e-12; versine < detail::kMaxVersine; versine *= 1.03)
    for (const double ratio : kRatios) {
      const long double half = std::acos(1 - static_cast<long double>(versine));
      double a, b;
      if (versine < detail::kSmallVersine)
        detail::slerp_small_weights(versine, ratio, a, b);
      else
        detail::slerp_weights(versine, ratio, a, b);
      const long double sine = std::sin(half);
      CHECK_NEAR(a, static_cast<double>(std::sin((1 - ratio) * half) / sine), 1e-14);
      CHECK_NEAR(b, static_cast<double>(std::sin(ratio * half) / sine), 1e-14);
    }
}

TEST(the_sine_of_a_quarter_turn_has_every_digit) {
  for (double x = 0; x <= 1.5707963267948966; x += 1e-4)
    CHECK_NEAR(x * detail::sine_to_angle(x * x), std::sin(x), 1e-15);
}
