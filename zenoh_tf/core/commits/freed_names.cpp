// Removed names that lose their ids, so that new names can take them.
//
// A removed frame keeps its id at first, so that its name can come back to it. Once a commit needs
// more ids than are left, all removed names lose theirs at once. This may take a while, but readers
// go on meanwhile: they wait only for frames that no name has, and for those whose past parents
// are replaced.
//
// Why nobody takes the next owner of an id for the last one
// 1. Data. A frame's samples, FrameEvents and the event log may hold ids of removed parents. They
//    are replaced by 0, under the frame's write lock and with a new version, before an id passes
//    on. A past link to such a parent then ends at its child, as if that were a root. Until the
//    topology mutex is released, no commit adds such an id: it adds only its rows' parents, and
//    without that mutex only ones that are newest parents already. Those are never removed.
// 2. Lookups. They compare the generations of their names' ids after the read (Tree::is_current),
//    or the counter ids_freed_ from before it (Tree::read_names). Both change before the frame is
//    unlocked with its new version, with release order, and readers load with acquire order. So a
//    lookup that has seen that version, or anything of the next owner, sees the change, too. One
//    that has seen nothing of it found the frame as it was removed, and is ordered before.
//    Failures keep the counter from before they were validated. So whoever names the frames of a
//    failure, or asks what they may still get, sees whether their ids have passed on.
// 3. Commits. Those that hold the topology mutex look their names up again, others compare
//    ids_freed_ under their children's locks (commits/names.hpp).
// 4. Read sets. They hold names and versions. A frame that loses its name gets a version above
//    those of all frames that ever lost theirs (version_base_), and so does one that is used for
//    the first time afterwards. The versions of a name therefore grow, whichever ids it has had,
//    and a read set from before its removal never passes. Nor does one that a lookup got afterwards
//    by an old Ref: such a Ref is no longer current.
// 5. Waiting lookups. Each removal wakes those that rest on the frame. One that rests on a past
//    link to it sees the child's new version, or waits for the child to change. One that is parked
//    under the frame of another name is woken without need, and parks again.
#include <algorithm>

#include "commits/write_locks.hpp"
#include "histories/insert.hpp"
#include "tree.hpp"

namespace ztf {

// Returns whether the frame holds the id of a removed one. Requires the topology mutex: then other
// commits may take such ids away, but add none.
bool Tree::refers_to_removed(FrameId id) const noexcept {
  const auto acquire = std::memory_order_acquire;
  const auto is_removed = [&](FrameId other) { return other != 0 && names_.hidden(other); };
  if (is_removed(events_[id].parent_before.load(acquire))) return true;
  const Frame& frame = frames_[id];
  // All its samples have one parent, and only a commit with the mutex adds one of another.
  if (frame.parent_changes.load(acquire) == 0) return false;
  return frame.version.read_consistent([&](Version) noexcept {
    const Ring ring = frame.ring.load(acquire);
    if (!ring || frame.parent_changes.load(acquire) == 0) return false;
    const std::uint32_t first = frame.first.load(acquire), count = frame.count.load(acquire);
    for (std::uint32_t i = 0; i < count; ++i)
      if (is_removed(ring.parent(first + i))) return true;
    return false;
  });
}

// Replaces the ids of removed frames by 0. Requires the topology mutex and the frame's write lock,
// and that readers wait. The newest sample's parent is never removed.
void Tree::forget_removed_parents(FrameId id) noexcept {
  const auto relaxed = std::memory_order_relaxed, release = std::memory_order_release;
  std::atomic<FrameId>& parent_before = events_[id].parent_before;
  if (names_.hidden(parent_before.load(relaxed))) parent_before.store(0, release);
  const auto is_removed = [&](FrameId parent) { return names_.hidden(parent); };
  if (forget_parents(frames_[id], is_removed)) increment(edits_[id]);
}

void Tree::list_removed_parents(FrameId id, std::vector<FrameId>& parents) const {
  const auto relaxed = std::memory_order_relaxed;
  parents.clear();
  const Frame& frame = frames_[id];
  const std::uint32_t count = frame.count.load(relaxed), first = frame.first.load(relaxed);
  if (count == 0 || frame.parent_changes.load(relaxed) == 0) return;
  const Ring ring = frame.ring.load(relaxed);
  FrameId last = 0;  // samples in a row mostly have one parent
  for (std::uint32_t i = 0; i < count; ++i) {
    const FrameId parent = ring.parent(first + i);
    if (parent != last && parent != 0 && names_.hidden(parent)) parents.push_back(parent);
    last = parent;
  }
  std::sort(parents.begin(), parents.end());
  parents.erase(std::unique(parents.begin(), parents.end()), parents.end());
}

void Tree::free_removed_names() {
  if (names_.hidden_names() == 0) return;
  LongWait::announce();
  const auto relaxed = std::memory_order_relaxed, release = std::memory_order_release;
  FrameList frames;  // those without a name, and those that refer to one
  for (FrameId id = 1; id <= names_.size(); ++id)
    if (names_.hidden(id) || refers_to_removed(id)) frames.push_back(id);
  {
    LogTicket ticket(change_log_.get());
    WriteLocks locks(*this, frames);
    log_orphans(ticket, locks);
    locks.begin_write();
    ticket.draw();
    moves_of_totals_.fetch_add(1, std::memory_order_seq_cst);
    for (const FrameId id : frames) {
      if (!names_.hidden(id)) {
        forget_removed_parents(id);
        continue;
      }
      version_base_ = std::max(version_base_, *locks.version_before(id) + SeqLock::kIncrement);
      Frame& frame = frames_[id];
      FrameEvents& events = events_[id];
      totals_of_freed_.rewritten += events.rewritten.load(relaxed);
      totals_of_freed_.dropped += events.dropped.load(relaxed);
      totals_of_freed_.evicted += frame.evicted.load(relaxed);
      frame.evicted.store(0, release);
      events.reset();
      names_.expire_refs(id);
    }
    moves_of_totals_.fetch_add(1, std::memory_order_seq_cst);
    event_log_.forget([&](FrameId id) { return names_.hidden(id); });
    ids_freed_.fetch_add(1, std::memory_order_seq_cst);
    locks.release_from(version_base_);
    ticket.publish();
  }
  // Few: no ids are freed while as many are left as the commit may need. No thread knows them.
  for (FrameId id = names_.size() + 1; id <= names_.max_size(); ++id)
    frames_[id].version.unlock_changed(version_base_ - SeqLock::kIncrement);
  names_.remove_hidden();
}

TreeTotals Tree::sum_totals() const noexcept {
  const auto acquire = std::memory_order_acquire;
  TreeTotals sum;
  sum.rewritten = totals_of_freed_.rewritten.load(acquire);
  sum.dropped = totals_of_freed_.dropped.load(acquire);
  sum.evicted = totals_of_freed_.evicted.load(acquire);
  for (FrameId id = 1, n = size(); id <= n; ++id) {
    const FrameInfo frame = info(id);
    const FrameEvents& events = events_[id];
    if (!removed(id)) ++sum.frames;
    if (frame.parent != 0 && frame.is_static)
      ++sum.static_links;
    else if (frame.parent != 0)
      sum.samples += frame.samples;
    sum.rewritten += events.rewritten.load(acquire);
    sum.dropped += events.dropped.load(acquire);
    sum.evicted += frame.evicted;
  }
  return sum;
}

// Counts that pass from a frame to totals_of_freed_ meanwhile might be summed twice, or not at all.
// A sum that has seen any of that sees the number change, too: it is odd before the first count is
// moved, and every load here has acquire order.
TreeTotals Tree::totals() const {
  constexpr int kAttempts = 3;
  for (int i = 0; i < kAttempts; ++i) {
    const std::uint64_t before = moves_of_totals_.load(std::memory_order_seq_cst);
    const TreeTotals sum = sum_totals();
    if (before % 2 == 0 && moves_of_totals_.load(std::memory_order_seq_cst) == before) return sum;
  }
  const auto topology = lock_announced(topology_);  // no name loses its id
  return sum_totals();
}

std::pair<std::vector<Tree::NamedEvent>, std::uint64_t> Tree::take_events() {
  std::vector<NamedEvent> named;
  const auto topology = lock_announced(topology_);  // no id passes to another name meanwhile
  const auto [events, lost] = event_log_.take();
  const auto name_of = [&](FrameId id) { return id != 0 ? name(id) : std::string(); };
  for (const TreeEvent& event : events)
    named.push_back({event, name_of(event.frame), name_of(info(event.frame).parent),
                     name_of(event.parent_before)});
  return {std::move(named), lost};
}

}  // namespace ztf
