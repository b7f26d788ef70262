// The forest of the newest links, for writes: depths, heights and subtrees in O(log n).
//
// Each tree of the forest is kept as its preorder, the frames in the order of a depth-first walk
// with their depths. There a frame's subtree is the run of deeper frames behind it. To link or cut
// it moves that run, and adds a number to its depths. The sequence is a treap, a binary search tree
// balanced by random priorities. A node's depth is stored relative to its treap parent's, so that a
// subtree of any size is moved by writing O(log n) nodes.
//
// Cost: each function takes O(log n) steps, expected over the random seed, for n frames in the
// trees concerned. That holds for every single call, whatever the forest and the calls before: so a
// chain of n links is built from either end, or in any order, in O(n log n), and no write holds the
// topology mutex for longer than O(log n) for each link that it changes. The seed is secret, so
// that nobody can choose frames whose priorities make a treap high.
//
// Thread safety: every function requires the tree's topology mutex. Lookups do not use it.
// Invariant, while no write is in progress: a frame is below its newest parent, or a root if it has
// none. While a commit is planned, it has the links that the commit will leave (CommitPlan).
#pragma once

#include <algorithm>
#include <utility>

#include "base/zeroed_array.hpp"
#include "records/frame.hpp"

namespace ztf {

class TopologyIndex {
 public:
  // All frames are roots without children.
  explicit TopologyIndex(std::size_t frames);

  // Returns how many links the frame is below its root.
  [[nodiscard]] std::uint32_t depth(FrameId id) const noexcept { return find_tree(id).depth; }
  // Returns how many links the lowest frame below this one is below it.
  [[nodiscard]] std::uint32_t height(FrameId id) const noexcept { return subtree_of(id).height; }
  // True if both frames have the same root.
  [[nodiscard]] bool connected(FrameId a, FrameId b) const noexcept {
    return find_tree(a).treap == find_tree(b).treap;
  }

  // Makes a root a child of a frame of another tree. Returns the depth of that tree's lowest frame.
  std::uint32_t link(FrameId root, FrameId parent) noexcept;
  // Makes the frame a root, and keeps what is below it. Does nothing if it is a root.
  void cut(FrameId id) noexcept;
  // Makes the frame a root without children. Requires the same call for all frames of its tree.
  void forget(FrameId id) noexcept { nodes_[id] = Node{}; }

  // Calls visit(id) for the frame and all below it, a frame before its children.
  template <class Visit>
  void visit_subtree(FrameId id, Visit&& visit) const {
    const FrameId end = subtree_of(id).end;
    for (; id != end; id = next(id)) visit(id);
  }
  // Returns one of the frame's children; 0 if it has none.
  [[nodiscard]] FrameId first_child(FrameId id) const noexcept;

  // How many nodes of treaps all calls have visited. Tests bound it.
  [[nodiscard]] std::uint64_t steps() const noexcept { return steps_; }

 private:
  // Zeroed: a frame alone in its tree. A pointer of 0 is none.
  struct Node {
    FrameId left, right, up;
    // This frame's depth, less that of `up`; without `up` the depth itself.
    std::int32_t depth;
    // The least and the most depth in this node's part of the treap, less this frame's.
    std::int32_t lowest, highest;
  };
  struct Tree {
    FrameId treap;  // its node without `up`
    std::uint32_t depth;
  };
  struct Subtree {
    FrameId end;  // the first frame in the preorder that is not below; 0: none
    std::uint32_t height;
  };
  using Halves = std::pair<FrameId, FrameId>;

  [[nodiscard]] Tree find_tree(FrameId id) const noexcept;
  [[nodiscard]] Subtree subtree_of(FrameId id) const noexcept;
  // The next frame in the preorder; 0 if there is none.
  [[nodiscard]] FrameId next(FrameId id) const noexcept;

  // Each takes treaps by their nodes without `up`, and returns such.
  FrameId merge(FrameId a, FrameId b) noexcept;
  Halves split_before(FrameId id) noexcept;
  Halves split_after(FrameId id) noexcept;
  Halves split_above(FrameId id, FrameId before, FrameId after) noexcept;

  void set_left(FrameId id, FrameId child) noexcept;
  void set_right(FrameId id, FrameId child) noexcept;
  void update(FrameId id) noexcept;
  [[nodiscard]] std::uint64_t priority(FrameId id) const noexcept;

  const ZeroedArray<Node> nodes_;
  const std::uint64_t seed_;
  mutable std::uint64_t steps_ = 0;
};

}  // namespace ztf
