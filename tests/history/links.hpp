// The links of the driver's tree, and the questions about them.
//
// The tree is a trunk of four links with two arms of four on it. The second arm moves between the
// trunk's top and the root.
#pragma once

#include <vector>

#include "tree.hpp"

namespace ztf {

constexpr int kLinks = 12;
constexpr int kDigits = 13;
constexpr Stamp kLastStamp = (1 << kDigits) - 1;

constexpr int place_of(int link) { return link % 4 * kDigits; }
constexpr int axis_of(int link) { return link / 4; }  // of Pose: x, y, z
constexpr int kMovingLink = 8;
// The frame above a link; frame 0 is the root. For the moving link its version decides.
constexpr int parent_of(int link, Stamp moved) {
  return link != kMovingLink ? link : moved / 4 % 2 == 0 ? 4 : 0;
}

// The links from a frame up to the root, as a set of bits.
inline unsigned links_above(int frame, Stamp moved) {
  unsigned links = 0;
  for (; frame != 0; frame = parent_of(frame - 1, moved)) links |= 1u << (frame - 1);
  return links;
}

using Ids = std::vector<FrameId>;  // of the links' frames

// The links between two frames: on the source's side, and on the target's, which count negative.
struct Between {
  unsigned down, up;
  [[nodiscard]] unsigned all() const { return down | up; }
};

struct Question {
  Question(const Ids& ids, Op op, int target_frame, int source_frame)
      : query{.op = op,
              .target = ids[static_cast<std::size_t>(target_frame)],
              .source = ids[static_cast<std::size_t>(source_frame)]},
        target(target_frame),
        source(source_frame) {}
  [[nodiscard]] Between links(Stamp moved) const {
    const unsigned above_target = links_above(target, moved),
                   above_source = links_above(source, moved);
    return {above_source & ~above_target, above_target & ~above_source};
  }
  Query query;
  int target, source;
};

}  // namespace ztf
