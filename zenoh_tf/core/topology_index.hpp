// What the newest links say the other way round: the children of each frame, and how high the tree
// below it is. Commits need it to limit depths, removals to find a subtree.
//
// Thread safety: every function requires the tree's topology mutex. Lookups do not use it.
// Invariants, while no write is in progress
// 1. A frame is in the list of its newest parent's children, and in no other.
// 2. A parent's height is at least that of each child plus 1. So height(f) is at least the number
//    of links from f down to its lowest descendant. It may be more: links that are taken away do
//    not lower it.
#pragma once

#include "frame.hpp"
#include "zeroed_array.hpp"

namespace ztf {

class TopologyIndex {
 public:
  explicit TopologyIndex(std::size_t frames) : nodes_(frames) {}

  [[nodiscard]] FrameId first_child(FrameId id) const noexcept { return nodes_[id].first_child; }
  [[nodiscard]] FrameId next_sibling(FrameId id) const noexcept { return nodes_[id].next; }

  void link(FrameId child, FrameId parent) noexcept {
    Node& node = nodes_[child];
    FrameId& first = nodes_[parent].first_child;
    node.previous = 0;
    node.next = first;
    if (first != 0) nodes_[first].previous = child;
    first = child;
  }
  void unlink(FrameId child, FrameId parent) noexcept {
    const Node& node = nodes_[child];
    if (node.previous != 0)
      nodes_[node.previous].next = node.next;
    else
      nodes_[parent].first_child = node.next;
    if (node.next != 0) nodes_[node.next].previous = node.previous;
  }

  [[nodiscard]] std::uint32_t height(FrameId id) const noexcept { return nodes_[id].height; }
  void set_height(FrameId id, std::uint32_t height) noexcept { nodes_[id].height = height; }

  // Marks of one walk: a depth for each frame that it has met. To begin a walk forgets all marks.
  static constexpr std::uint32_t kUnmarked = (1u << 24) - 1;
  static constexpr std::uint32_t kOnPath = kUnmarked - 1;
  static constexpr std::uint32_t kDeepest = kOnPath - 1;  // greater depths are marked as this one

  void begin_walk() noexcept { ++walk_; }
  [[nodiscard]] std::uint32_t mark(FrameId id) const noexcept {
    const std::uint64_t mark = nodes_[id].mark;
    return mark >> kDepthBits == walk_ ? static_cast<std::uint32_t>(mark & kUnmarked) : kUnmarked;
  }
  void set_mark(FrameId id, std::uint32_t depth) noexcept {
    nodes_[id].mark = walk_ << kDepthBits | depth;
  }

 private:
  static constexpr int kDepthBits = 24;
  struct Node {
    std::uint64_t mark;  // the walk's number and the depth
    FrameId first_child, next, previous;
    std::uint32_t height;
  };

  const ZeroedArray<Node> nodes_;
  std::uint64_t walk_ = 0;
};

}  // namespace ztf
