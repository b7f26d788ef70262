// The real tf2: its BufferCore, as installed. It knows names only, and one lookup at a time.
#include <geometry_msgs/TransformStamped.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>

#include <algorithm>
#include <tuple>

#include "buffer.hpp"

namespace bench {

namespace {

class Tf2Buffer final : public Buffer {
 public:
  void write(const Link* links, std::size_t count) override {
    for (const Link* link = links; link != links + count; ++link) {
      message_.header.frame_id = link->parent;
      message_.child_frame_id = link->child;
      message_.header.stamp.fromNSec(static_cast<std::uint64_t>(link->stamp));
      auto& t = message_.transform.translation;
      auto& q = message_.transform.rotation;
      std::tie(t.x, t.y, t.z, q.x, q.y, q.z, q.w) = std::tuple_cat(link->pose);
      buffer_.setTransform(message_, authority_);
    }
  }

  Stamp lookup(Call call) override {
    if (call == Call::nothing) return 0;
    const Stamp tool = find(tool_, ros::Time(0)).stamp;
    return call == Call::two_poses ? std::min(tool, find(elbow_, ros::Time(0)).stamp) : tool;
  }

  Answer tool_at(Stamp stamp) override {
    return find(tool_, ros::Time().fromNSec(static_cast<std::uint64_t>(stamp)));
  }

 private:
  Answer find(const std::string& source, const ros::Time& time) const {
    try {
      const auto found = buffer_.lookupTransform(map_, source, time);
      const auto& t = found.transform.translation;
      const auto& q = found.transform.rotation;
      return {static_cast<Stamp>(found.header.stamp.toNSec()), {t.x, t.y, t.z, q.x, q.y, q.z, q.w}};
    } catch (const tf2::TransformException&) {
      return {};
    }
  }

  const std::string authority_ = "arm", map_ = kMap, tool_ = kTool, elbow_ = kElbow;
  geometry_msgs::TransformStamped message_;  // its strings keep their memory
  tf2::BufferCore buffer_;
};

}  // namespace

std::unique_ptr<Buffer> make_buffer(const std::string&) { return std::make_unique<Tf2Buffer>(); }

}  // namespace bench
