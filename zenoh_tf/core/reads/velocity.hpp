// The velocity of one frame in another: the mean twist between two of its poses.
//
// Notation: a twist holds a rigid body's angular velocity and the velocity of one of its points.
// The angular velocity is the same at all points. From one point to another the linear velocity
// changes by angular x (other - point).
// Metres, radians, seconds.
// Thread safety: values.
#pragma once

#include "geometry/screw.hpp"
#include "reads/query.hpp"

namespace ztf {

struct Twist {
  Vec3 linear = {0, 0, 0}, angular = {0, 0, 0};
};

struct VelocityQuery {
  FrameId tracking, observation, reference, point_frame;  // 0 for an unknown frame
  Stamp stamp;                  // kNoStamp: the latest common time of tracking and observation
  Stamp interval;               // ns, above 0
  Vec3 point;                   // in point_frame: the point of the body whose velocity is asked for
  Stamp max_gap = kNoGapLimit;  // as of Query
};

struct VelocityAnswer {
  // The lookups: tracking in observation, observation in reference, point_frame in observation.
  enum class Leg : std::uint8_t { tracking, reference, point };

  Failure failure;
  Leg leg;      // the lookup that failed
  Twist twist;  // in the axes of the reference frame
  Stamp stamp, start, end;
  Stamp gap;  // ns, the longest gap that a pose was interpolated over
};

// The mean twist of a body that moves from pose `start` to pose `end` in that many seconds. Linear
// is the velocity of the body's origin. The axes are those of the frame that both poses are in.
inline Twist twist_between(const Pose& start, const Pose& end, double seconds) noexcept {
  const double rate = 1.0 / seconds;
  const Vec3 rotation = rotation_vector(end * inverse(start));
  return {{(end.x - start.x) * rate, (end.y - start.y) * rate, (end.z - start.z) * rate},
          {rotation.x * rate, rotation.y * rate, rotation.z * rate}};
}

// The twist of the same motion with the linear velocity of the point at an offset of `arm`.
inline Twist shift_reference_point(const Twist& twist, const Vec3& arm) noexcept {
  const Vec3 change = cross(twist.angular, arm);
  return {{twist.linear.x + change.x, twist.linear.y + change.y, twist.linear.z + change.z},
          twist.angular};
}

// The same twist in the axes of frame a, given in those of b.
inline Twist rotate_twist(const Pose& ab, const Twist& twist) noexcept {
  return {rotate(ab, twist.linear.x, twist.linear.y, twist.linear.z),
          rotate(ab, twist.angular.x, twist.angular.y, twist.angular.z)};
}

}  // namespace ztf
