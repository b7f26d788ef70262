// Rotation vectors, distances of poses, and motion with a constant twist.
//
// Thread safety: functions of their arguments.
#pragma once

#include <cmath>

#include "geometry/pose.hpp"

namespace ztf {

inline Vec3 cross(const Vec3& a, const Vec3& b) noexcept {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// The pose's rotation as axis times angle, with an angle of at most pi.
inline Vec3 rotation_vector(const Pose& p) noexcept {
  const double sine2 = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz;  // squared sine of the half angle
  const double cosine = std::abs(p.qw);
  double scale;  // angle / sine
  if (sine2 < 1e-6) {
    const double tangent2 = sine2 / (cosine * cosine);  // series of atan(t) / t, error < 1e-18
    scale = 2.0 / cosine * (1.0 - tangent2 * (1.0 / 3 - tangent2 * (1.0 / 5)));
  } else {
    const double sine = std::sqrt(sine2);
    scale = 2.0 * std::atan2(sine, cosine) / sine;
  }
  if (p.qw < 0) scale = -scale;  // q and -q are the same rotation
  return {p.qx * scale, p.qy * scale, p.qz * scale};
}

// How far two poses are apart.
struct Residual {
  double metres, radians;
};

inline double norm(const Vec3& v) noexcept { return std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z); }

inline Residual residual_between(const Pose& a, const Pose& b) noexcept {
  const double w = a.qw * b.qw + a.qx * b.qx + a.qy * b.qy + a.qz * b.qz;
  // The vector part of inverse(a) * b gives a small angle without loss, unlike the arc cosine.
  const Vec3 v{a.qw * b.qx - a.qx * b.qw - a.qy * b.qz + a.qz * b.qy,
               a.qw * b.qy - a.qy * b.qw - a.qz * b.qx + a.qx * b.qz,
               a.qw * b.qz - a.qz * b.qw - a.qx * b.qy + a.qy * b.qx};
  return {norm({b.x - a.x, b.y - a.y, b.z - a.z}), 2 * std::atan2(norm(v), std::abs(w))};
}

namespace detail {

// Squared angles below it use series, with errors below 1e-10. They take half of the time.
inline constexpr double kSmallSquare = 0.1;

// The factors of the exponential of a twist: with the angle a, (1 - cos a) / a^2,
// (a - sin a) / a^3, sin(a / 2) / a and cos(a / 2).
struct ScrewFactors {
  double first, second, sine, cosine;

  explicit ScrewFactors(double square) noexcept {
    const double half = 0.25 * square;  // square of the half angle
    if (square < kSmallSquare) [[likely]] {
      first = 1.0 / 2 - square * (1.0 / 24 - square * (1.0 / 720 - square * (1.0 / 40320)));
      second = 1.0 / 6 - square * (1.0 / 120 - square * (1.0 / 5040 - square * (1.0 / 362880)));
      sine = 0.5 - half * (1.0 / 12 - half * (1.0 / 240 - half * (1.0 / 10080)));
      cosine = 1 - half * (1.0 / 2 - half * (1.0 / 24 - half * (1.0 / 720 - half / 40320)));
    } else {
      const double angle = std::sqrt(square);
      first = (1 - std::cos(angle)) / square;
      second = (angle - std::sin(angle)) / (square * angle);
      sine = std::sin(0.5 * angle) / angle;
      cosine = std::cos(0.5 * angle);
    }
  }
};

// rotation_vector(), with the same error and speed as the above.
inline Vec3 fast_rotation_vector(const Pose& p) noexcept {
  const double square = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz, t = square / (p.qw * p.qw);
  if (!(t < 0.25 * kSmallSquare)) [[unlikely]]
    return rotation_vector(p);
  // atan(x) / x, for t = x^2
  const double series =
      1 - t * (1.0 / 3 - t * (1.0 / 5 - t * (1.0 / 7 - t * (1.0 / 9 - t * (1.0 / 11)))));
  const double scale = 2 / p.qw * series;
  return {p.qx * scale, p.qy * scale, p.qz * scale};
}

}  // namespace detail

// Returns the pose of a body that continues from `newer`, with the constant body twist that has
// moved it there from `older`, for `ratio` times as long as that took.
inline Pose carry_on(const Pose& older, const Pose& newer, double ratio) noexcept {
  const auto plus = [](const Vec3& a, double scale, const Vec3& b) {
    return Vec3{a.x + scale * b.x, a.y + scale * b.y, a.z + scale * b.z};
  };
  const Pose step = inverse(older) * newer;
  const Vec3 turn = detail::fast_rotation_vector(step), shift{step.x, step.y, step.z};
  const double square = turn.x * turn.x + turn.y * turn.y + turn.z * turn.z;
  double log_factor;
  if (square < detail::kSmallSquare) [[likely]] {
    log_factor = 1.0 / 12 + square * (1.0 / 720 + square * (1.0 / 30240 + square / 1209600));
  } else {
    const double half = 0.5 * std::sqrt(square);
    log_factor = (1 - half / std::tan(half)) / square;
  }
  const Vec3 turned = cross(turn, shift);
  const Vec3 path = plus(plus(shift, -0.5, turned), log_factor, cross(turn, turned));

  const detail::ScrewFactors factors(ratio * ratio * square);
  const Vec3 zero{0, 0, 0}, end_turn = plus(zero, ratio, turn), end_path = plus(zero, ratio, path);
  const Vec3 bent = cross(end_turn, end_path);
  const Vec3 t = plus(plus(end_path, factors.first, bent), factors.second, cross(end_turn, bent));
  return newer * Pose{t.x,
                      t.y,
                      t.z,
                      factors.sine * end_turn.x,
                      factors.sine * end_turn.y,
                      factors.sine * end_turn.z,
                      factors.cosine};
}

}  // namespace ztf
