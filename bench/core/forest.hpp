// The trees that are asked, and how their links move.
//
// Thread safety: values.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "workload.hpp"

namespace bench {

using FrameIndex = std::uint32_t;

// A frame's link is the one to its parent. Parents come before their children; who is its own
// parent is a root.
struct Forest {
  std::vector<std::string> names;
  std::vector<FrameIndex> parents;

  FrameIndex add(std::string name, FrameIndex parent);
  [[nodiscard]] FrameIndex size() const { return static_cast<FrameIndex>(names.size()); }
};

// link0 - link1 - link2 - ...
Forest snake(FrameIndex links);
// Five limbs of twelve links on one body: 60 links, 12 deep.
Forest humanoid();
// Robots of 30 frames (a base and four chains) under one map.
Forest fleet(unsigned robots);

// Where a link is at a time. All links turn and move by small steps back and forth, as robots do.
const ztf::Pose& pose_at(FrameIndex link, Stamp stamp);

}  // namespace bench
