// How one frame moves in another: the mean twist between two of its poses.
//
// Notation: a twist holds a rigid body's angular velocity and the velocity of
// one of its points. Angular velocity is one and the same all over the body;
// from a point to another the linear part grows by angular x (other - point).
// Metres, radians, seconds.
// Thread safety: values.
#pragma once

#include "query.hpp"

namespace ztf {

struct Twist {
  Vec3 linear = {0, 0, 0}, angular = {0, 0, 0};
};

struct VelocityQuery {
  FrameId tracking, observation, reference, point_frame;  // 0: unknown
  Stamp stamp;     // kNoStamp: the latest common time of tracking and observation
  Stamp interval;  // ns, above 0
  Vec3 point;      // in point_frame: where the body's point is whose velocity is asked for
};

struct VelocityAnswer {
  // What is looked up: tracking in observation, observation in reference, point_frame in
  // observation.
  enum class Leg : std::uint8_t { tracking, reference, point };

  Failure failure;
  Leg leg;      // where it failed
  Twist twist;  // in the axes of the reference frame
  Stamp stamp, start, end;
};

inline Vec3 cross(const Vec3& a, const Vec3& b) noexcept {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// A pose's rotation as axis times angle, at most half a turn.
inline Vec3 rotation_vector(const Pose& p) noexcept {
  const double sine2 = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz;  // of the half angle, squared
  const double cosine = std::abs(p.qw);
  double scale;  // angle / sine
  if (sine2 < 1e-6) {
    const double tangent2 = sine2 / (cosine * cosine);  // atan(t) / t by its series, below 1e-18
    scale = 2.0 / cosine * (1.0 - tangent2 * (1.0 / 3 - tangent2 * (1.0 / 5)));
  } else {
    const double sine = std::sqrt(sine2);
    scale = 2.0 * std::atan2(sine, cosine) / sine;
  }
  if (p.qw < 0) scale = -scale;  // q and -q are one rotation
  return {p.qx * scale, p.qy * scale, p.qz * scale};
}

// Of a body whose pose was `start`, and is `end` so many seconds later; `linear` is of its origin.
// In the axes of the frame that both poses are in.
inline Twist twist_between(const Pose& start, const Pose& end, double seconds) noexcept {
  const double rate = 1.0 / seconds;
  const Vec3 turn = rotation_vector(end * inverse(start));
  return {{(end.x - start.x) * rate, (end.y - start.y) * rate, (end.z - start.z) * rate},
          {turn.x * rate, turn.y * rate, turn.z * rate}};
}

// The same motion, by the body's point that lies `arm` further.
inline Twist shift_reference_point(const Twist& twist, const Vec3& arm) noexcept {
  const Vec3 around = cross(twist.angular, arm);
  return {{twist.linear.x + around.x, twist.linear.y + around.y, twist.linear.z + around.z},
          twist.angular};
}

// The same motion in the axes of frame a, from those of b.
inline Twist rotate_twist(const Pose& ab, const Twist& twist) noexcept {
  return {rotate(ab, twist.linear.x, twist.linear.y, twist.linear.z),
          rotate(ab, twist.angular.x, twist.angular.y, twist.angular.z)};
}

}  // namespace ztf
