// The real tf2::BufferCore beside ours, for the tests that ask both.
//
// C++17, since ROS 1 messages need std::allocator::rebind.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "check.hpp"
#include "zenoh_tf/tf2_buffer_core.hpp"

using zenoh_tf::Pose;

constexpr std::uint64_t kSecond = 1'000'000'000;
constexpr Pose kIdentity{0, 0, 0, 0, 0, 0, 1};

template <class Number>
std::string nth(const std::string& prefix, Number n) {
  return prefix + std::to_string(n);
}

inline Pose random_pose(std::mt19937& random) {
  std::uniform_real_distribution<double> number(-1, 1);
  Pose p{number(random),
         number(random),
         number(random),
         number(random),
         number(random),
         number(random),
         1.5};
  const double norm = std::sqrt(p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw);
  for (double* q : {&p.qx, &p.qy, &p.qz, &p.qw}) *q /= norm;
  return p;
}

inline double distance(const Pose& a, const Pose& b) {
  const double sign = a.qx * b.qx + a.qy * b.qy + a.qz * b.qz + a.qw * b.qw < 0 ? -1 : 1;
  double most = 0;
  for (const double d : {a.x - b.x, a.y - b.y, a.z - b.z, a.qx - sign * b.qx, a.qy - sign * b.qy,
                         a.qz - sign * b.qz, a.qw - sign * b.qw})
    most = std::isnan(d) ? INFINITY : std::max(most, std::abs(d));
  return most;
}

inline ros::Time at(std::uint64_t ns) {
  ros::Time time;
  return time.fromNSec(ns);
}

inline geometry_msgs::TransformStamped transform_of(const std::string& parent,
                                                    const std::string& child, std::uint64_t stamp,
                                                    const Pose& p) {
  geometry_msgs::TransformStamped out;
  out.header.frame_id = parent;
  out.header.stamp = at(stamp);
  out.child_frame_id = child;
  out.transform.translation.x = p.x, out.transform.translation.y = p.y;
  out.transform.translation.z = p.z;
  out.transform.rotation.x = p.qx, out.transform.rotation.y = p.qy;
  out.transform.rotation.z = p.qz, out.transform.rotation.w = p.qw;
  return out;
}

inline Pose pose_of(const geometry_msgs::TransformStamped& m) {
  const auto& t = m.transform.translation;
  const auto& q = m.transform.rotation;
  return {t.x, t.y, t.z, q.x, q.y, q.z, q.w};
}

// What a call returns or throws.
struct Outcome {
  std::string kind, text;
  geometry_msgs::TransformStamped message;
};

template <class Call>
Outcome outcome_of(Call&& call) {
  try {
    return {"ok", "", call()};
  } catch (const tf2::LookupException& error) {
    return {"lookup", error.what(), {}};
  } catch (const tf2::ConnectivityException& error) {
    return {"connectivity", error.what(), {}};
  } catch (const tf2::InvalidArgumentException& error) {
    return {"invalid", error.what(), {}};
  } catch (const tf2::ExtrapolationException& error) {
    return {"extrapolation", error.what(), {}};
  }
}

// A text as far as it does not say which of several links has no data.
inline std::string without_link(const std::string& text) {
  const std::string begin = "Lookup would require extrapolation ";
  if (text.compare(0, begin.size(), begin) != 0) return text;
  return begin + text.substr(text.find(", when looking up"));
}

inline void check_same(const Outcome& theirs, const Outcome& ours) {
  CHECK_EQ(ours.kind, theirs.kind);
  CHECK_EQ(without_link(ours.text), without_link(theirs.text));
  CHECK_EQ(ours.message.header.stamp, theirs.message.header.stamp);
  CHECK_EQ(ours.message.header.frame_id, theirs.message.header.frame_id);
  CHECK_EQ(ours.message.child_frame_id, theirs.message.child_frame_id);
  if (theirs.kind == "ok") CHECK(distance(pose_of(ours.message), pose_of(theirs.message)) < 1e-9);
}

// Both buffers, with the same transforms.
struct Both {
  tf2::BufferCore theirs{ros::Duration(1000)};
  zenoh_tf::BufferCore ours{ros::Duration(1000)};

  void set(const geometry_msgs::TransformStamped& message, const std::string& authority,
           bool is_static = false) {
    CHECK_EQ(ours.setTransform(message, authority, is_static),
             theirs.setTransform(message, authority, is_static));
  }
};
