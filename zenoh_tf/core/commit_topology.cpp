// What a commit may do to the newest links: close no cycle, and put no frame too deep.
//
// Both checks are linear. Each frame above a changed link is visited once, because it keeps its
// depth as a mark; so a commit costs at most as many steps as there are such frames.
//
// Depths. Let c be the lowest frame on a frame's path to the root whose link this commit changes.
// The frame's new depth is that of c, plus the links below c, which stay as they are. It is
// therefore enough to compare depth(c) + height(c) with the limit, for each c. The index knows an
// upper bound of the height. If that is too much, the subtree is walked, unless it has more than
// kMaxWalk frames: then the bound counts.
#include <algorithm>

#include "commit_apply.hpp"

namespace ztf {

namespace {

constexpr std::uint32_t kMaxWalk = 10'000;

}  // namespace

void CommitPlan::check_topology() {
  changed_links_.clear();
  tree_.topology_index_.begin_walk();
  for (std::uint32_t i = 0; i < groups_.size(); ++i)
    if (groups_[i].new_parent != 0) changed_links_.push_back({depth_after(groups_[i].child), i});
  const std::uint32_t limit = tree_.options_.max_depth;
  for (const ChangedLink& link : changed_links_) {
    const FrameId child = groups_[link.group].child;
    if (link.depth + tree_.topology_index_.height(child) <= limit) [[likely]]
      continue;
    const std::uint32_t depth = link.depth + height_of_unchanged(child);
    if (depth > limit) reject_depth(groups_[link.group], depth);
  }
  std::sort(changed_links_.begin(), changed_links_.end(),
            [](const ChangedLink& a, const ChangedLink& b) { return a.depth > b.depth; });
}

// Returns how many links the frame will be below its root. Marks all frames above it.
std::uint32_t CommitPlan::depth_after(FrameId start) const {
  TopologyIndex& index = tree_.topology_index_;
  SmallVector<FrameId, 64> path;
  std::uint32_t depth = 0;  // of the next frame to be marked
  for (FrameId frame = start; frame != 0; frame = parent_after(frame)) {
    const std::uint32_t mark = index.mark(frame);
    if (mark == TopologyIndex::kOnPath) reject_cycle(frame);
    if (mark != TopologyIndex::kUnmarked) {
      depth = mark + 1;
      break;
    }
    index.set_mark(frame, TopologyIndex::kOnPath);
    path.push_back(frame);
  }
  for (std::size_t i = path.size(); i-- > 0; ++depth)
    index.set_mark(path[i], std::min(depth, TopologyIndex::kDeepest));
  return index.mark(start);
}

// Returns how many links the tree goes down from this frame, over those that this commit does not
// change; for a large subtree an upper bound. Throws bad_alloc.
std::uint32_t CommitPlan::height_of_unchanged(FrameId top) const {
  TopologyIndex& index = tree_.topology_index_;
  std::vector<FrameId> frames{top};  // level by level
  std::uint32_t height = 0, visited = 0;
  bool all_stay = true;
  for (std::size_t begin = 0, end = 1;; begin = end, end = frames.size(), ++height) {
    for (std::size_t i = begin; i < end; ++i)
      for (FrameId child = index.first_child(frames[i]); child != 0;
           child = index.next_sibling(child)) {
        if (++visited > kMaxWalk) return index.height(top);
        const FrameWrites* const group = group_of(child);
        const bool stays = !(group && group->new_parent != 0);
        all_stay &= stays;
        if (stays) frames.push_back(child);
      }
    if (frames.size() == end) break;
  }
  if (!all_stay) return height;
  // Corrects the bounds of the whole subtree, so that no parent's is lower than a child's plus 1.
  for (const FrameId frame : frames) index.set_height(frame, 0);
  for (std::size_t i = frames.size(); i-- > 1;) {
    const FrameId parent = tree_.frames_[frames[i]].parent.load(std::memory_order_relaxed);
    index.set_height(parent, std::max(index.height(parent), index.height(frames[i]) + 1));
  }
  return height;
}

FrameId CommitPlan::parent_after(FrameId id) const noexcept {
  if (const FrameWrites* const group = group_of(id); group && group->new_parent != 0)
    return group->new_parent;
  return tree_.frames_[id].parent.load(std::memory_order_relaxed);
}

// Names the first of the cycle's frames whose link this commit changes. There is one, because the
// links were a forest before.
void CommitPlan::reject_cycle(FrameId on_cycle) const {
  const FrameWrites* first = nullptr;
  FrameId frame = on_cycle;
  do {
    const FrameWrites* const group = group_of(frame);
    if (group && group->new_parent != 0 && (!first || group->child < first->child)) first = group;
    frame = parent_after(frame);
  } while (frame != on_cycle);
  reject(request_, request_.rows[writes_[first->begin].row], "parent_frame",
         "the link would close a cycle");
}

void CommitPlan::reject_depth(const FrameWrites& group, std::uint32_t depth) const {
  const Row& row = request_.rows[writes_[group.begin].row];
  const std::string child(stripped(request_.names[row.child]));
  throw Rejected{.code = Code::limit,
                 .message = "cannot set the transform of child " + quoted(child) +
                            ": it, or a frame below it, would be " + with_separators(depth) +
                            " links below its root, and the limit is " +
                            with_separators(tree_.options_.max_depth) + " (max_depth)",
                 .frame = child,
                 .parent = std::string(stripped(request_.names[row.parent])),
                 .field = "max_depth",
                 .limit = tree_.options_.max_depth,
                 .value = depth};
}

void CommitExecution::update_heights() noexcept {
  // The lowest come first: they raise the frames above them to their final heights, and the others
  // find nothing left to do. So each frame is raised once, or a few times.
  TopologyIndex& index = tree_.topology_index_;
  for (const ChangedLink& link : plan_.changed_links()) {
    FrameId frame = plan_.groups()[link.group].child;
    std::uint32_t height = index.height(frame);
    while ((frame = tree_.frames_[frame].parent.load(std::memory_order_relaxed)) != 0 &&
           index.height(frame) < ++height)
      index.set_height(frame, height);
  }
}

}  // namespace ztf
