// What a commit may do to the newest links: close no cycle, and put no frame too deep.
//
// The plan changes the topology index as the commit will change the links: it cuts all children
// that get another parent, then links them one by one. A cycle closes exactly if a child is to be
// linked to a frame of its own tree. A tree is too deep exactly if its lowest frame is. Both are
// decided on what the links will be, whatever the order of the rows. If the commit is not applied,
// undo_links() restores the index.
//
// Cost: O(log n) for each changed link, whatever the forest looks like
// (records/topology_index.hpp). A check that follows links, or keeps a depth or a height with each
// frame, costs as many steps as there are frames above or below the link: a chain of n links then
// costs n squared, built either from its root or from its leaf.
#include <algorithm>

#include "commits/plan.hpp"

namespace ztf {

void CommitPlan::change_links() {
  for (std::uint32_t i = 0; i < groups_.size(); ++i)
    if (groups_[i].new_parent != 0) changed_links_.push_back(i);
  TopologyIndex& index = tree_.topology_index;
  for (const std::uint32_t i : changed_links_) index.cut(groups_[i].child);
  bool is_too_deep = false;
  for (const std::uint32_t i : changed_links_) {
    const auto [child, parent] = std::pair(groups_[i].child, groups_[i].new_parent);
    if (index.connected(child, parent)) [[unlikely]] {
      if (request_.drop_bad) return change_links_one_by_one();
      reject_cycle(groups_[i]);
    }
    is_too_deep |= index.link(child, parent) > limit_of_depths();
  }
  if (is_too_deep) [[unlikely]] {
    if (request_.drop_bad) return change_links_one_by_one();
    reject_depth();
  }
}

// Changes the links again, one after the other in the order of their rows, and refuses those that
// cannot be changed, as if each row were a commit of its own.
void CommitPlan::change_links_one_by_one() {
  TopologyIndex& index = tree_.topology_index;
  undo_links();
  for (std::uint32_t i = 0; i < groups_.size(); ++i)
    if (groups_[i].new_parent != 0) changed_links_.push_back(i);
  std::sort(changed_links_.begin(), changed_links_.end(), [&](std::uint32_t a, std::uint32_t b) {
    return writes_[groups_[a].begin].row < writes_[groups_[b].begin].row;
  });
  for (const std::uint32_t i : changed_links_) {
    const auto [child, parent] = std::pair(groups_[i].child, groups_[i].new_parent);
    const FrameId before = groups_[i].frame->parent.load(std::memory_order_relaxed);
    std::uint8_t result = RowResult::stored;
    index.cut(child);
    if (index.connected(child, parent)) {
      result = RowResult::cycle;
    } else if (index.link(child, parent) > limit_of_depths()) {
      index.cut(child);
      result = RowResult::too_deep;
    }
    if (result == RowResult::stored) continue;
    if (before != 0) index.link(child, before);
    refuse_group(groups_[i], result);
  }
}

std::uint32_t CommitPlan::limit_of_depths() const noexcept {
  const std::uint32_t limit = tree_.options.max_depth;
  return limit != 0 ? limit : std::numeric_limits<std::uint32_t>::max();
}

void CommitPlan::undo_links() noexcept {
  TopologyIndex& index = tree_.topology_index;
  for (const std::uint32_t i : changed_links_) index.cut(groups_[i].child);
  for (const std::uint32_t i : changed_links_) {
    const FrameWrites& group = groups_[i];
    const FrameId parent = group.frame->parent.load(std::memory_order_relaxed);
    if (parent != 0) index.link(group.child, parent);
  }
  changed_links_.clear();
}

// Names the first of the cycle's frames whose link this commit changes. `last` is the one whose
// link would close the cycle; the others are linked. One of them is on the cycle exactly if the
// path from the new parent up to `last` ends without its link.
void CommitPlan::reject_cycle(const FrameWrites& last) {
  TopologyIndex& index = tree_.topology_index;
  const FrameWrites* first = &last;
  for (const std::uint32_t i : changed_links_) {
    if (&groups_[i] == &last) break;
    index.cut(groups_[i].child);
    if (index.connected(last.child, last.new_parent)) continue;
    first = &groups_[i];
    break;
  }
  reject(request_, request_.rows[writes_[first->begin].row], "parent_frame",
         "the link would close a cycle");
}

// Names the first frame that would be too deep, or above one that is, and whose link this commit
// changes. There is one, because no tree was too deep before.
void CommitPlan::reject_depth() const {
  const TopologyIndex& index = tree_.topology_index;
  const auto deepest = [&](std::uint32_t i) {
    return index.depth(groups_[i].child) + index.height(groups_[i].child);
  };
  const std::uint32_t* at = changed_links_.begin();
  while (deepest(*at) <= limit_of_depths()) ++at;
  const std::uint32_t depth = deepest(*at);
  const Row& row = request_.rows[writes_[groups_[*at].begin].row];
  const std::string child(stripped(request_.names[row.child]));
  throw Rejected{.code = Code::limit,
                 .message = "cannot set the transform of child " + quoted(child) +
                            ": it, or a frame below it, would be " + with_separators(depth) +
                            " links below its root, and the limit is " +
                            with_separators(tree_.options.max_depth) + " (max_depth)",
                 .frame = child,
                 .parent = std::string(stripped(request_.names[row.parent])),
                 .field = "max_depth",
                 .limit = tree_.options.max_depth,
                 .value = depth};
}

}  // namespace ztf
