// What ROS 2's messages have, in our words: as far as tf2_buffer_core.hpp uses it.
#pragma once

#include <cstdint>
#include <string>

namespace builtin_interfaces::msg {

struct Time {
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
};

}  // namespace builtin_interfaces::msg

namespace geometry_msgs::msg {

struct TransformStamped {
  struct {
    builtin_interfaces::msg::Time stamp;
    std::string frame_id;
  } header;
  std::string child_frame_id;
  struct {
    struct {
      double x = 0, y = 0, z = 0;
    } translation;
    struct {
      double x = 0, y = 0, z = 0, w = 1;
    } rotation;
  } transform;
};

}  // namespace geometry_msgs::msg
