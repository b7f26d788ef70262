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

// The motion with a constant body twist from one pose to another, continued for `ratio` times as
// long as it took. With the rotation vector w and the translation t of the step, it is the
// exponential of `ratio` times the logarithm of the step.
template <class T>
struct Screw {
  Vec3Of<T> turn;   // w
  T log_factor;     // (1 - a / 2 cot(a / 2)) / a^2, a = |w|
  T first, second;  // (1 - cos e) / e^2, (e - sin e) / e^3,
  T sine, cosine;   // sin(e / 2) / e and cos(e / 2), e = ratio a

  ZTF_ALWAYS_INLINE static Vec3Of<T> cross(const Vec3Of<T>& a, const Vec3Of<T>& b) noexcept {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
  ZTF_ALWAYS_INLINE static Vec3Of<T> plus(const Vec3Of<T>& a, T scale,
                                          const Vec3Of<T>& b) noexcept {
    return {a.x + scale * b.x, a.y + scale * b.y, a.z + scale * b.z};
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE PoseOf<T> exponential(const PoseOf<T>& step,
                                                        T ratio) const noexcept {
    const Vec3Of<T> t{step.x, step.y, step.z}, turned = cross(turn, t);
    const Vec3Of<T> path = plus(plus(t, T{} - 0.5, turned), log_factor, cross(turn, turned));
    const Vec3Of<T> w{ratio * turn.x, ratio * turn.y, ratio * turn.z};
    const Vec3Of<T> v{ratio * path.x, ratio * path.y, ratio * path.z}, bent = cross(w, v);
    const Vec3Of<T> end = plus(plus(v, first, bent), second, cross(w, bent));
    return {end.x, end.y, end.z, sine * w.x, sine * w.y, sine * w.z, cosine};
  }
};

// Squared angles below it use series, with errors below 1e-10: they take half of the time.
inline constexpr double kSmallSquare = 0.1;

// Returns the end of that motion, by series. Sets a bound of the squares of both angles: the
// result is meaningful only where that is below kSmallSquare.
template <class T>
ZTF_ALWAYS_INLINE PoseOf<T> carry_on_by_series(const PoseOf<T>& older, const PoseOf<T>& newer,
                                               T ratio, T& largest) noexcept {
  const PoseOf<T> step = inverse(older) * newer;
  // atan(x) / x, with x^2 = t
  const T t = (step.qx * step.qx + step.qy * step.qy + step.qz * step.qz) / (step.qw * step.qw);
  const T scale =
      2.0 / step.qw *
      (1.0 - t * (1.0 / 3 - t * (1.0 / 5 - t * (1.0 / 7 - t * (1.0 / 9 - t * (1.0 / 11))))));
  Screw<T> screw;
  screw.turn = {step.qx * scale, step.qy * scale, step.qz * scale};
  const T a =
      screw.turn.x * screw.turn.x + screw.turn.y * screw.turn.y + screw.turn.z * screw.turn.z;
  const T e = ratio * ratio * a, half = 0.25 * e;
  screw.log_factor = 1.0 / 12 + a * (1.0 / 720 + a * (1.0 / 30240 + a * (1.0 / 1209600)));
  screw.first = 1.0 / 2 - e * (1.0 / 24 - e * (1.0 / 720 - e * (1.0 / 40320)));
  screw.second = 1.0 / 6 - e * (1.0 / 120 - e * (1.0 / 5040 - e * (1.0 / 362880)));
  screw.sine = 0.5 - half * (1.0 / 12 - half * (1.0 / 240 - half * (1.0 / 10080)));
  screw.cosine =
      1.0 - half * (1.0 / 2 - half * (1.0 / 24 - half * (1.0 / 720 - half * (1.0 / 40320))));
  // 4 t is at least the square of the angle of the step, and neither of the two may be large.
  largest = e + 4.0 * t;
  return newer * screw.exponential(step, ratio);
}

// Returns the pose of a body that continues from `newer`, with the constant body twist that has
// moved it there from `older`, for `ratio` times as long as that took.
inline Pose carry_on(const Pose& older, const Pose& newer, double ratio) noexcept {
  double largest;
  const Pose by_series = carry_on_by_series(older, newer, ratio, largest);
  if (largest < kSmallSquare) [[likely]]
    return by_series;
  const Pose step = inverse(older) * newer;
  const Vec3 turn = rotation_vector(step);
  const double angle = norm(turn), end = std::abs(ratio) * angle, half = 0.5 * angle;
  // Below these angles the quotients lose precision.
  const bool is_small = angle < 1e-3, ends_small = end < 1e-3;
  const Screw<double> screw{
      .turn = turn,
      .log_factor = is_small ? 1.0 / 12 : (1 - half / std::tan(half)) / (angle * angle),
      .first = ends_small ? 1.0 / 2 : (1 - std::cos(end)) / (end * end),
      .second = ends_small ? 1.0 / 6 : (end - std::sin(end)) / (end * end * end),
      .sine = ends_small ? 0.5 : std::sin(0.5 * end) / end,
      .cosine = std::cos(0.5 * end)};
  return newer * screw.exponential(step, ratio);
}

}  // namespace ztf
