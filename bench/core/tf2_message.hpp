// What tf2 is told of a transform. C++17, as all that includes tf2.
//
// Thread safety: functions of their arguments.
#pragma once

#include <geometry_msgs/TransformStamped.h>

#include <string>

#include "workload.hpp"

namespace bench {

inline ros::Time time_of(Stamp stamp) {
  return ros::Time().fromNSec(static_cast<std::uint64_t>(stamp));
}

// Into a message that may be used again: its texts keep their list.
inline void fill(geometry_msgs::TransformStamped& m, const std::string& parent,
                 const std::string& child, Stamp stamp, const ztf::Pose& pose) {
  m.header.frame_id = parent;
  m.child_frame_id = child;
  m.header.stamp = time_of(stamp);
  m.transform.translation.x = pose.x;
  m.transform.translation.y = pose.y;
  m.transform.translation.z = pose.z;
  m.transform.rotation.x = pose.qx;
  m.transform.rotation.y = pose.qy;
  m.transform.rotation.z = pose.qz;
  m.transform.rotation.w = pose.qw;
}

}  // namespace bench
