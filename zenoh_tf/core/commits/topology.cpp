// What a commit may do to the newest links: close no cycle, and put no frame too deep.
//
// From each child that gets another parent, a walk follows the links as the commit will leave them,
// whatever the order of the rows. It ends at the root, or at the child itself, which closes a
// cycle, or after max_depth links. Frames below the child are not looked at: if it takes them too
// deep, their lookups say so.
//
// Cost: at most max_depth steps for each changed link. Without a limit a link costs as many steps
// as there are frames above its child; but not one of a new child, below which there is nothing
// yet. So a chain of any length is built from either end, link by link.
#include <algorithm>

#include "commits/plan.hpp"

namespace ztf {

void CommitPlan::check_links() {
  for (FrameWrites& group : groups_) group.is_linked = group.new_parent != 0;
  std::uint8_t worst = RowResult::stored;
  const FrameWrites* bad = nullptr;
  for (const FrameWrites& group : groups_) {
    if (!group.is_linked || worst == RowResult::cycle) continue;
    // A walk that runs into a cycle of others ends as too deep.
    const std::uint8_t result = check_link(group);
    if (result == RowResult::stored || result == worst) continue;
    worst = result;
    bad = &group;
  }
  if (!bad) return;
  if (!request_.drop_bad) refuse_group(*bad, worst);
  check_links_one_by_one();
}

// Checks the links again, one after the other in the order of their rows, and refuses those that
// cannot be changed, as if each row were a commit of its own.
void CommitPlan::check_links_one_by_one() {
  SmallVector<FrameWrites*, 16> changed;
  for (FrameWrites& group : groups_)
    if (std::exchange(group.is_linked, false)) changed.push_back(&group);
  std::sort(changed.begin(), changed.end(), [&](const FrameWrites* a, const FrameWrites* b) {
    return writes_[a->begin].row < writes_[b->begin].row;
  });
  for (FrameWrites* const group : changed) {
    group->is_linked = true;
    const std::uint8_t result = check_link(*group);
    if (result == RowResult::stored) continue;
    group->is_linked = false;
    refuse_group(*group, result);
  }
}

// Walks up from a child whose link changes. Returns RowResult::stored if that may be, else why not.
std::uint8_t CommitPlan::check_link(const FrameWrites& group) const noexcept {
  // New frames have nothing below them but what this commit links. If all changed children are new,
  // no walk returns to one of them once it has left them.
  const bool is_local =
      tree_.options.max_depth == 0 && std::all_of(groups_.begin(), groups_.end(), [&](auto& each) {
        return !each.is_linked || tree_.removed(each.child);
      });
  const std::uint32_t limit = tree_.options.max_path();
  FrameId at = group.new_parent;
  for (std::uint32_t depth = 1; at != 0; ++depth) {
    if (at == group.child) return RowResult::cycle;
    if (depth > limit) return RowResult::too_deep;
    const FrameWrites* const planned = group_of(at);
    if (planned && planned->is_linked)
      at = planned->new_parent;
    else if (!is_local)
      at = tree_.frames[at].parent.load(std::memory_order_relaxed);
    else
      break;
  }
  return RowResult::stored;
}

}  // namespace ztf
