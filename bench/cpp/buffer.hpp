// What readers look up in, and what they are asked for: the poses of an arm's links in the map.
//
// Thread safety: write() from one thread, all else from another one at the same time.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>

namespace bench {

using Stamp = std::int64_t;          // ns
using Pose = std::array<double, 7>;  // x, y, z, qx, qy, qz, qw

// A transform as the publisher sends it in a datagram.
struct Link {
  char parent[16], child[16];
  Stamp stamp;
  Pose pose;
};

constexpr const char *kMap = "map", *kTool = "link7", *kElbow = "link4";

// Of the tool at the latest common time, by names or by frames that were found once; of the tool
// and the elbow; or nothing, to measure what a measurement takes.
enum class Call { names, reference, two_poses, nothing };

struct Answer {
  Stamp stamp = -1;  // -1: there is none
  Pose pose{};
};

class Buffer {
 public:
  virtual ~Buffer() = default;
  virtual void write(const Link* links, std::size_t count) = 0;
  // Returns the stamp, or -1; of Call::nothing 0.
  virtual Stamp lookup(Call call) = 0;
  virtual Answer tool_at(Stamp stamp) = 0;
};

// server: the folder of its socket; empty: the buffer is this process's, which tf2's always is.
std::unique_ptr<Buffer> make_buffer(const std::string& server);

}  // namespace bench
