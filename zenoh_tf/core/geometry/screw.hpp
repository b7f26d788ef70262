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

// Returns the pose of a body that continues from `newer`, with the constant body twist that has
// moved it there from `older`, for `ratio` times as long as that took.
inline Pose carry_on(const Pose& older, const Pose& newer, double ratio) noexcept {
  const auto plus = [](const Vec3& a, double scale, const Vec3& b) {
    return Vec3{a.x + scale * b.x, a.y + scale * b.y, a.z + scale * b.z};
  };
  constexpr double kSmall = 1e-3;  // squared angles below it use series, with errors below 1e-12
  const Pose step = inverse(older) * newer;
  const Vec3 turn = rotation_vector(step), shift{step.x, step.y, step.z};
  const double angle2 = turn.x * turn.x + turn.y * turn.y + turn.z * turn.z;
  const double half = 0.5 * std::sqrt(angle2);
  const double log_factor = angle2 < kSmall
                                ? 1.0 / 12 + angle2 * (1.0 / 720 + angle2 * (1.0 / 30240))
                                : (1 - half / std::tan(half)) / angle2;
  const Vec3 turned = cross(turn, shift);
  const Vec3 path = plus(plus(shift, -0.5, turned), log_factor, cross(turn, turned));

  const double end2 = ratio * ratio * angle2, end = 2 * std::abs(ratio) * half;
  double first, second, sine;  // (1 - cos) / end2, (end - sin) / (end2 end), sin(end / 2) / end
  if (end2 < kSmall) {
    first = 1.0 / 2 - end2 * (1.0 / 24 - end2 * (1.0 / 720));
    second = 1.0 / 6 - end2 * (1.0 / 120 - end2 * (1.0 / 5040));
    sine = 1.0 / 2 - end2 * (1.0 / 48 - end2 * (1.0 / 3840));
  } else {
    first = (1 - std::cos(end)) / end2;
    second = (end - std::sin(end)) / (end2 * end);
    sine = std::sin(0.5 * end) / end;
  }
  const Vec3 zero{0, 0, 0}, end_turn = plus(zero, ratio, turn), end_path = plus(zero, ratio, path);
  const Vec3 bent = cross(end_turn, end_path);
  const Vec3 t = plus(plus(end_path, first, bent), second, cross(end_turn, bent));
  return newer * Pose{t.x,
                      t.y,
                      t.z,
                      sine * end_turn.x,
                      sine * end_turn.y,
                      sine * end_turn.z,
                      std::cos(0.5 * end)};
}

}  // namespace ztf
