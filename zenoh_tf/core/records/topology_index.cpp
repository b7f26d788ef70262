// How preorders are split, merged and searched.
#include "records/topology_index.hpp"

#include <random>

namespace ztf {

namespace {

std::uint64_t random_seed() {
  std::random_device device;
  return std::uint64_t{device()} << 32 | device();
}

}  // namespace

TopologyIndex::TopologyIndex(std::size_t frames) : nodes_(frames), seed_(random_seed()) {}

// The finalizer of MurmurHash3: every bit of the seed changes all bits of the priority.
std::uint64_t TopologyIndex::priority(FrameId id) const noexcept {
  std::uint64_t x = seed_ ^ id;
  x = (x ^ x >> 33) * 0xFF51AFD7ED558CCD;
  x = (x ^ x >> 33) * 0xC4CEB9FE1A85EC53;
  return x ^ x >> 33;
}

TopologyIndex::Tree TopologyIndex::find_tree(FrameId id) const noexcept {
  std::int32_t depth = nodes_[id].depth;
  for (FrameId up; (up = nodes_[id].up) != 0; id = up, ++steps_) depth += nodes_[up].depth;
  ++steps_;
  return {id, static_cast<std::uint32_t>(depth)};
}

// Searches the frames behind `id` for the first that is not deeper. Depths are relative to its own.
TopologyIndex::Subtree TopologyIndex::subtree_of(FrameId id) const noexcept {
  std::int32_t height = 0;
  // Searches a part of a treap whose topmost frame has that depth. Returns 0 if all are deeper.
  const auto search = [&](FrameId at, std::int32_t depth) -> FrameId {
    if (at == 0) return 0;
    if (depth + nodes_[at].lowest > 0) {
      height = std::max(height, depth + nodes_[at].highest);
      return 0;
    }
    for (;; ++steps_) {
      const Node& node = nodes_[at];
      if (const FrameId left = node.left; left != 0) {
        const std::int32_t left_depth = depth + nodes_[left].depth;
        if (left_depth + nodes_[left].lowest <= 0) {
          at = left;
          depth = left_depth;
          continue;
        }
        height = std::max(height, left_depth + nodes_[left].highest);
      }
      if (depth <= 0) return at;
      height = std::max(height, depth);
      at = node.right;  // there is one: something here is not deeper
      depth += nodes_[at].depth;
    }
  };
  const auto search_right = [&](FrameId at, std::int32_t depth) {
    const FrameId right = nodes_[at].right;
    return search(right, depth + nodes_[right].depth);
  };
  std::int32_t depth = 0;
  FrameId end = search_right(id, depth);
  for (FrameId up; end == 0 && (up = nodes_[id].up) != 0; id = up, ++steps_) {
    depth -= nodes_[id].depth;
    if (nodes_[up].left != id) continue;  // what is up and left of it precedes it
    height = std::max(height, depth);
    end = depth <= 0 ? up : search_right(up, depth);
  }
  return {end, static_cast<std::uint32_t>(height)};
}

FrameId TopologyIndex::next(FrameId id) const noexcept {
  FrameId at = nodes_[id].right;
  if (at != 0) {
    for (; nodes_[at].left != 0; ++steps_) at = nodes_[at].left;
    return at;
  }
  for (; (at = nodes_[id].up) != 0 && nodes_[at].left != id; ++steps_) id = at;
  return at;
}

FrameId TopologyIndex::first_child(FrameId id) const noexcept {
  const FrameId after = next(id);
  return after != subtree_of(id).end ? after : FrameId{0};
}

std::uint32_t TopologyIndex::link(FrameId root, FrameId parent) noexcept {
  const FrameId subtree = find_tree(root).treap;
  const std::uint32_t depth = find_tree(parent).depth + 1;
  const auto [before, after] = split_after(parent);
  nodes_[subtree].depth += static_cast<std::int32_t>(depth);
  const Node& all = nodes_[merge(merge(before, subtree), after)];
  return static_cast<std::uint32_t>(all.depth + all.highest);
}

void TopologyIndex::cut(FrameId id) noexcept {
  const std::uint32_t depth = find_tree(id).depth;
  if (depth == 0) return;
  const FrameId end = subtree_of(id).end;
  Halves rest = split_before(id);
  const FrameId before = rest.first;
  rest = end != 0 ? split_before(end) : Halves{rest.second, 0};
  nodes_[rest.first].depth -= static_cast<std::int32_t>(depth);
  (void)merge(before, rest.second);
}

// Requires that all frames of a precede those of b, and that their depths are relative to the same.
FrameId TopologyIndex::merge(FrameId a, FrameId b) noexcept {
  if (a == 0 || b == 0) return a | b;
  ++steps_;
  if (priority(a) > priority(b)) {
    nodes_[b].depth -= nodes_[a].depth;
    set_right(a, merge(nodes_[a].right, b));
    update(a);
    return a;
  }
  nodes_[a].depth -= nodes_[b].depth;
  set_left(b, merge(a, nodes_[b].left));
  update(b);
  return b;
}

TopologyIndex::Halves TopologyIndex::split_before(FrameId id) noexcept {
  const FrameId before = nodes_[id].left;
  nodes_[id].left = 0;
  return split_above(id, before, id);
}

TopologyIndex::Halves TopologyIndex::split_after(FrameId id) noexcept {
  const FrameId after = nodes_[id].right;
  nodes_[id].right = 0;
  return split_above(id, id, after);
}

// Splits what is above `id` between the two halves, of which one has `id` on top, and the other
// what was a child of it. Up to the root, the depths of both are relative to the node's that was
// reached last.
TopologyIndex::Halves TopologyIndex::split_above(FrameId id, FrameId before,
                                                 FrameId after) noexcept {
  FrameId at = id, up = nodes_[id].up;
  std::int32_t depth = std::exchange(nodes_[id].depth, 0);
  update(id);
  for (;; ++steps_) {
    if (before != 0) nodes_[before].depth += depth;
    if (after != 0) nodes_[after].depth += depth;
    if (up == 0) break;
    depth = std::exchange(nodes_[up].depth, 0);
    const FrameId next_up = nodes_[up].up;
    if (nodes_[up].left == at) {
      set_left(up, after);
      after = up;
    } else {
      set_right(up, before);
      before = up;
    }
    update(up);
    at = std::exchange(up, next_up);
  }
  if (before != 0) nodes_[before].up = 0;
  if (after != 0) nodes_[after].up = 0;
  return {before, after};
}

void TopologyIndex::set_left(FrameId id, FrameId child) noexcept {
  nodes_[id].left = child;
  if (child != 0) nodes_[child].up = id;
}

void TopologyIndex::set_right(FrameId id, FrameId child) noexcept {
  nodes_[id].right = child;
  if (child != 0) nodes_[child].up = id;
}

void TopologyIndex::update(FrameId id) noexcept {
  Node& node = nodes_[id];
  node.lowest = node.highest = 0;
  for (const FrameId child : {node.left, node.right}) {
    if (child == 0) continue;
    const Node& part = nodes_[child];
    node.lowest = std::min(node.lowest, part.depth + part.lowest);
    node.highest = std::max(node.highest, part.depth + part.highest);
  }
}

}  // namespace ztf
