// The signatures of ROS 2's tf2::BufferCore, from Humble to Jazzy, in our words: those that
// zenoh_tf::BufferCore has too. Nothing is defined.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "geometry_msgs/msg/transform_stamped.hpp"

namespace tf2 {

using Duration = std::chrono::nanoseconds;
using TimePoint = std::chrono::time_point<std::chrono::system_clock, Duration>;
using TransformableRequestHandle = std::uint64_t;
enum TransformableResult { TransformAvailable, TransformFailure };

class BufferCoreInterface {
 public:
  using Message = geometry_msgs::msg::TransformStamped;
  using Text = const std::string&;

  virtual ~BufferCoreInterface() = default;
  virtual void clear() = 0;
  virtual Message lookupTransform(Text target, Text source, const TimePoint& time) const = 0;
  virtual Message lookupTransform(Text target, const TimePoint& target_time, Text source,
                                  const TimePoint& source_time, Text fixed) const = 0;
  virtual bool canTransform(Text target, Text source, const TimePoint& time,
                            std::string* error) const = 0;
  virtual bool canTransform(Text target, const TimePoint& target_time, Text source,
                            const TimePoint& source_time, Text fixed, std::string* error) const = 0;
  virtual std::vector<std::string> getAllFrameNames() const = 0;
};

class BufferCore : public BufferCoreInterface {
 public:
  using TransformableCallback = std::function<void(TransformableRequestHandle, Text target,
                                                   Text source, TimePoint, TransformableResult)>;
  static const std::uint32_t MAX_GRAPH_DEPTH = 1000;

  explicit BufferCore(Duration cache_time = std::chrono::seconds(10));
  void clear() override;
  bool setTransform(const Message& transform, Text authority, bool is_static = false);
  Message lookupTransform(Text, Text, const TimePoint&) const override;
  Message lookupTransform(Text, const TimePoint&, Text, const TimePoint&, Text) const override;
  bool canTransform(Text, Text, const TimePoint&, std::string* = nullptr) const override;
  bool canTransform(Text, const TimePoint&, Text, const TimePoint&, Text,
                    std::string* = nullptr) const override;
  std::vector<std::string> getAllFrameNames() const override;
  std::string allFramesAsYAML(TimePoint now) const;
  std::string allFramesAsYAML() const;
  std::string allFramesAsString() const;
  TransformableRequestHandle addTransformableRequest(const TransformableCallback& callback,
                                                     Text target, Text source, TimePoint time);
  void cancelTransformableRequest(TransformableRequestHandle handle);
  void setUsingDedicatedThread(bool value);
  bool isUsingDedicatedThread() const;
  bool _frameExists(Text name) const;
  bool _getParent(Text name, TimePoint time, std::string& parent) const;
  void _getFrameStrings(std::vector<std::string>& names) const;
  Duration getCacheLength();
};

}  // namespace tf2
