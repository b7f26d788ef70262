// The folder `geometry/`: poses and points; it knows no frames.
// In: poses, and arrays of points. Out: products, interpolated poses, moved points.
// It may include base.
//
// Poses and their arithmetic, which avoids trigonometry for small angles.
//
// Notation: X_parent_child maps a point's coordinates in child to coordinates in parent. So
// X_ac = X_ab * X_bc. Rotations are unit quaternions (x, y, z, w).
// Thread safety: values.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/compiler.hpp"

namespace ztf {

// A rigid transform. T is double, or a vector of doubles for as many poses at once
// (geometry/pose4.hpp).
template <class T>
struct PoseOf {
  T x = {}, y = {}, z = {};                     // translation, metres
  T qx = {}, qy = {}, qz = {}, qw = T{} + 1.0;  // rotation
};
using Pose = PoseOf<double>;

template <class T>
struct Vec3Of {
  T x, y, z;
};
using Vec3 = Vec3Of<double>;

// Returns offset + R v - v, where R is the pose's rotation: R v - v = w u + q x u, u = 2 q x v.
template <class T>
ZTF_ALWAYS_INLINE Vec3Of<T> add_rotation(const PoseOf<T>& p, const Vec3Of<T>& v,
                                         const Vec3Of<T>& offset) noexcept {
  const T x2 = p.qx + p.qx, y2 = p.qy + p.qy, z2 = p.qz + p.qz;
  const T ux = y2 * v.z - z2 * v.y;
  const T uy = z2 * v.x - x2 * v.z;
  const T uz = x2 * v.y - y2 * v.x;
  return {offset.x + p.qw * ux + p.qy * uz - p.qz * uy,  //
          offset.y + p.qw * uy + p.qz * ux - p.qx * uz,  //
          offset.z + p.qw * uz + p.qx * uy - p.qy * ux};
}

// Rotates v by the pose's rotation.
template <class T>
ZTF_ALWAYS_INLINE Vec3Of<T> rotate(const PoseOf<T>& p, T vx, T vy, T vz) noexcept {
  const Vec3Of<T> v{vx, vy, vz};
  return add_rotation(p, v, v);
}

// Returns X_ac = X_ab * X_bc. Sums run from left to right, so that each term can be a fused
// multiply-add.
template <class T>
ZTF_ALWAYS_INLINE PoseOf<T> operator*(const PoseOf<T>& ab, const PoseOf<T>& bc) noexcept {
  const Vec3Of<T> v{bc.x, bc.y, bc.z};
  const Vec3Of<T> t = add_rotation(ab, v, {ab.x + bc.x, ab.y + bc.y, ab.z + bc.z});
  return {t.x,
          t.y,
          t.z,
          ab.qw * bc.qx + ab.qx * bc.qw + ab.qy * bc.qz - ab.qz * bc.qy,
          ab.qw * bc.qy + ab.qy * bc.qw + ab.qz * bc.qx - ab.qx * bc.qz,
          ab.qw * bc.qz + ab.qz * bc.qw + ab.qx * bc.qy - ab.qy * bc.qx,
          ab.qw * bc.qw - ab.qx * bc.qx - ab.qy * bc.qy - ab.qz * bc.qz};
}

// Returns X_ba. Requires a unit rotation.
template <class T>
ZTF_ALWAYS_INLINE PoseOf<T> inverse(const PoseOf<T>& ab) noexcept {
  PoseOf<T> ba{{}, {}, {}, -ab.qx, -ab.qy, -ab.qz, ab.qw};
  const Vec3Of<T> t = rotate(ba, -ab.x, -ab.y, -ab.z);
  ba.x = t.x;
  ba.y = t.y;
  ba.z = t.z;
  return ba;
}

namespace detail {

// Returns sin(a * h) / sin(h) for 0 <= a <= 1 and h2 = h * h <= 0.002, by its series in h2 with an
// error below 1e-14. The terms depend on each other as little as possible, because interpolation
// waits for them.
template <class T>
ZTF_ALWAYS_INLINE T sine_ratio(T a, T h2) noexcept {
  const T b = a * a;
  const T scale = a * (1.0 - b);
  const T first = scale * (1.0 / 6);
  const T second = scale * (7.0 / 360 - b * (3.0 / 360));
  const T third = scale * (31.0 / 15120 + b * (b * (3.0 / 15120) - 18.0 / 15120));
  return (a + h2 * first) + (h2 * h2) * (second + h2 * third);
}

// Returns c[0] + c[1] x + c[2] x^2 + ..., as two sums that do not wait for each other.
template <class T, std::size_t N>
ZTF_ALWAYS_INLINE T polynomial(const double (&c)[N], T x) noexcept {
  static_assert(N % 2 == 0);
  const T x2 = x * x;
  T even = T{} + c[N - 2], odd = T{} + c[N - 1];
  for (std::size_t i = N - 2; i > 0; i -= 2) {
    even = even * x2 + c[i - 2];
    odd = odd * x2 + c[i - 1];
  }
  return even + odd * x;
}

// Returns sin(x) / x of x2 = x * x, for |x| <= pi/2, with an error below 1e-15.
template <class T>
ZTF_ALWAYS_INLINE T sine_to_angle(T x2) noexcept {
  constexpr double kSeries[] = {1.0,
                                -1.0 / 6,
                                1.0 / 120,
                                -1.0 / 5040,
                                1.0 / 362880,
                                -1.0 / 39916800,
                                1.0 / 6227020800,
                                -1.0 / 1307674368000,
                                1.0 / 355687428096000,
                                -1.0 / 121645100408832000};
  return polynomial(kSeries, x2);
}

// The two functions set slerp's weights of two quaternions without trigonometry. `versine` is 1 -
// cosine of the half angle h between the rotations. It must be below kSmallVersine, rotations that
// are less than 5 degrees apart, or below kMaxVersine, less than 40 degrees.
constexpr double kSmallVersine = 0.001, kMaxVersine = 0.06;
template <class T>
ZTF_ALWAYS_INLINE void slerp_small_weights(T versine, T ratio, T& wa, T& wb) noexcept {
  // The square of the half angle: 2 v + v^2/3 + 4 v^3/45 + ...
  const T h2 = (versine + versine) + (versine * versine) * (1.0 / 3 + versine * (4.0 / 45));
  wa = sine_ratio(1.0 - ratio, h2);
  wb = sine_ratio(ratio, h2);
}
template <class T>
ZTF_ALWAYS_INLINE void slerp_weights(T versine, T ratio, T& wa, T& wb) noexcept {
  // h^2 / v = 2 sum 2^n v^(n-1) / (n^2 C(2n, n)), h / sin(h) = sum 2^n v^n n!^2 / (2n+1)!: the
  // series of the arc sine, of sin(h / 2) = sqrt(v / 2).
  constexpr double kSquare[] = {
      2.0,        1.0 / 3,      4.0 / 45,   1.0 / 35,       16.0 / 1575,
      8.0 / 2079, 32.0 / 21021, 4.0 / 6435, 256.0 / 984555, 128.0 / 1154725};
  constexpr double kAngleToSine[] = {
      1.0,       1.0 / 3,     2.0 / 15,    2.0 / 35,       8.0 / 315,
      8.0 / 693, 16.0 / 3003, 16.0 / 6435, 128.0 / 109395, 128.0 / 230945};
  const T h2 = versine * polynomial(kSquare, versine);
  const T angle_to_sine = polynomial(kAngleToSine, versine);
  const T a = 1.0 - ratio;
  wa = a * angle_to_sine * sine_to_angle(a * a * h2);
  wb = ratio * angle_to_sine * sine_to_angle(ratio * ratio * h2);
}

}  // namespace detail

// Interpolates linearly in translation and by slerp along the shorter arc in rotation. Requires a
// ratio in [0, 1].
inline Pose interpolate(const Pose& a, const Pose& b, double ratio) noexcept {
  const double dot = a.qx * b.qx + a.qy * b.qy + a.qz * b.qz + a.qw * b.qw;
  const double sign = dot < 0 ? -1.0 : 1.0;  // q and -q are the same rotation
  const double cosine = std::min(std::abs(dot), 1.0);
  const double versine = 1.0 - cosine;
  double wa, wb;
  if (versine < detail::kSmallVersine) [[likely]] {
    detail::slerp_small_weights(versine, ratio, wa, wb);
  } else if (versine < detail::kMaxVersine) {
    detail::slerp_weights(versine, ratio, wa, wb);
  } else {
    const double half = std::acos(cosine);
    const double scale = 1.0 / std::sin(half);
    wa = std::sin((1.0 - ratio) * half) * scale;
    wb = std::sin(ratio * half) * scale;
  }
  wb *= sign;
  return {a.x + (b.x - a.x) * ratio, a.y + (b.y - a.y) * ratio, a.z + (b.z - a.z) * ratio,
          wa * a.qx + wb * b.qx,     wa * a.qy + wb * b.qy,     wa * a.qz + wb * b.qz,
          wa * a.qw + wb * b.qw};
}

}  // namespace ztf
