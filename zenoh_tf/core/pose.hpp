// Poses and their arithmetic, free of trigonometry where it can be.
//
// Notation: X_parent_child maps a point's coordinates in child to coordinates
// in parent; X_ac = X_ab * X_bc. Rotations are unit quaternions (x, y, z, w).
// Thread safety: values.
#pragma once

#include <algorithm>
#include <cmath>

// For the few functions whose calls would cost as much as their work.
#define ZTF_ALWAYS_INLINE [[gnu::always_inline]] inline

// For functions in which arithmetic is most of the work: compiled a second time for processors
// with fused multiply-add and wide vectors, and chosen when the program is loaded.
#if defined(__x86_64__) && defined(__GLIBC__) && __GNUC__ >= 12 && !defined(__clang__) && \
    !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
#define ZTF_MULTIVERSION __attribute__((target_clones("default", "arch=x86-64-v3")))
#else
#define ZTF_MULTIVERSION
#endif

namespace ztf {

// Of doubles; or of several in each component, for as many poses at once (pose4.hpp).
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

// By how much the pose's rotation moves v, added to `to`: w u + q x u, with u = 2 q x v.
template <class T>
ZTF_ALWAYS_INLINE Vec3Of<T> add_turn(const PoseOf<T>& p, const Vec3Of<T>& v,
                                     const Vec3Of<T>& to) noexcept {
  const T x2 = p.qx + p.qx, y2 = p.qy + p.qy, z2 = p.qz + p.qz;
  const T ux = y2 * v.z - z2 * v.y;
  const T uy = z2 * v.x - x2 * v.z;
  const T uz = x2 * v.y - y2 * v.x;
  return {to.x + p.qw * ux + p.qy * uz - p.qz * uy,  //
          to.y + p.qw * uy + p.qz * ux - p.qx * uz,  //
          to.z + p.qw * uz + p.qx * uy - p.qy * ux};
}

// Rotates v by the pose's rotation.
template <class T>
ZTF_ALWAYS_INLINE Vec3Of<T> rotate(const PoseOf<T>& p, T vx, T vy, T vz) noexcept {
  const Vec3Of<T> v{vx, vy, vz};
  return add_turn(p, v, v);
}

// X_ac = X_ab * X_bc. Sums from left to right: so fused instructions make them without a rest.
template <class T>
ZTF_ALWAYS_INLINE PoseOf<T> operator*(const PoseOf<T>& ab, const PoseOf<T>& bc) noexcept {
  const Vec3Of<T> v{bc.x, bc.y, bc.z};
  const Vec3Of<T> t = add_turn(ab, v, {ab.x + bc.x, ab.y + bc.y, ab.z + bc.z});
  return {t.x,
          t.y,
          t.z,
          ab.qw * bc.qx + ab.qx * bc.qw + ab.qy * bc.qz - ab.qz * bc.qy,
          ab.qw * bc.qy + ab.qy * bc.qw + ab.qz * bc.qx - ab.qx * bc.qz,
          ab.qw * bc.qz + ab.qz * bc.qw + ab.qx * bc.qy - ab.qy * bc.qx,
          ab.qw * bc.qw - ab.qx * bc.qx - ab.qy * bc.qy - ab.qz * bc.qz};
}

// X_ba from X_ab, for a unit rotation.
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

// sin(a * h) / sin(h) for 0 <= a <= 1 and h2 = h * h <= 0.002, by its series in
// h2; truncation below 1e-14. In short chains: who interpolates waits for them.
template <class T>
ZTF_ALWAYS_INLINE T sine_ratio(T a, T h2) noexcept {
  const T b = a * a;
  const T scale = a * (1.0 - b);
  const T first = scale * (1.0 / 6);
  const T second = scale * (7.0 / 360 - b * (3.0 / 360));
  const T third = scale * (31.0 / 15120 + b * (b * (3.0 / 15120) - 18.0 / 15120));
  return (a + h2 * first) + (h2 * h2) * (second + h2 * third);
}

// Where the rotations are close (rest = 1 - cosine of the half angle, below kClose): the two
// quaternions' weights, without trigonometry.
constexpr double kClose = 0.001;
template <class T>
ZTF_ALWAYS_INLINE void weights_if_close(T rest, T ratio, T& wa, T& wb) noexcept {
  // The square of the half angle from its cosine: 2 r + r^2/3 + 4 r^3/45 + ...
  const T h2 = (rest + rest) + (rest * rest) * (1.0 / 3 + rest * (4.0 / 45));
  wa = sine_ratio(1.0 - ratio, h2);
  wb = sine_ratio(ratio, h2);
}

}  // namespace detail

// Linear in translation, slerp along the shorter arc in rotation; ratio in [0, 1].
inline Pose interpolate(const Pose& a, const Pose& b, double ratio) noexcept {
  const double dot = a.qx * b.qx + a.qy * b.qy + a.qz * b.qz + a.qw * b.qw;
  const double sign = dot < 0 ? -1.0 : 1.0;  // q and -q are one rotation
  const double cosine = std::min(std::abs(dot), 1.0);
  const double rest = 1.0 - cosine;
  double wa, wb;
  if (rest < detail::kClose) [[likely]] {
    detail::weights_if_close(rest, ratio, wa, wb);
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
