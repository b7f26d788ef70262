// Removed names that lose their ids, so that new names can take them.
//
// A removed frame keeps its id at first, so that its name can come back to it. Once a commit needs
// more ids than are left, all removed names lose theirs at once. This may take a while, but readers
// continue meanwhile: they wait only for frames that no name has, and for those whose past parents
// are replaced.
//
// Why nobody mistakes the next owner of an id for the last one
// 1. Data. A frame's samples, FrameEvents and the event log may hold ids of removed parents. They
//    are replaced by 0, under the frame's write lock and with a new version, before an id passes
//    on. A past link to such a parent then ends at its child, as if that were a root. Until the
//    topology mutex is released, no commit adds such an id: it adds only its rows' parents, and
//    without that mutex only ones that are newest parents already. Those are never removed.
// 2. Lookups. They compare the generations of their names' ids after the read
//    (NameTable::is_current), or the counter ids_freed from before it (TreeState::read_names). Both
//    change before the frame is unlocked with its new version, with release order, and readers load
//    with acquire order. So a lookup that has seen that version, or anything of the next owner,
//    sees the change, too. One that has seen nothing of it found the frame as it was removed, and
//    is ordered before. Failures keep the counter from before they were validated. So whoever names
//    the frames of a failure, or asks what they may still get, sees whether their ids have passed
//    on.
// 3. Commits. Those that hold the topology mutex look their names up again, others compare
//    ids_freed under their children's locks (commits/names.hpp).
// 4. Read sets. They hold names and versions. A frame that loses its name gets a version above
//    those of all frames that ever lost theirs (version_base), and so does one that is used for
//    the first time afterwards. The versions of a name therefore grow, whichever ids it has had,
//    and a read set from before its removal never passes. Nor does one that a lookup got afterwards
//    by an old Ref: such a Ref is no longer current.
// 5. Waiting lookups. Each removal wakes those that rest on the frame. One that rests on a past
//    link to it sees the child's new version, or waits for the child to change. One that is parked
//    under the frame of another name is woken without need, and parks again.
#include "commits/freed_names.hpp"

#include <algorithm>
#include <map>
#include <vector>

#include "commits/write_locks.hpp"
#include "histories/insert.hpp"

namespace ztf {

namespace {

// Returns whether the frame holds the id of a removed one. Requires the topology mutex: then other
// commits may take such ids away, but add none.
bool refers_to_removed(const TreeState& tree, FrameId id) noexcept {
  const auto acquire = std::memory_order_acquire;
  const auto is_removed = [&](FrameId other) { return other != 0 && tree.names.removed(other); };
  if (is_removed(tree.events[id].parent_before.load(acquire))) return true;
  const Frame& frame = tree.frames[id];
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
void forget_removed_parents(TreeState& tree, FrameId id) noexcept {
  const auto relaxed = std::memory_order_relaxed, release = std::memory_order_release;
  std::atomic<FrameId>& parent_before = tree.events[id].parent_before;
  if (tree.names.removed(parent_before.load(relaxed))) parent_before.store(0, release);
  const auto is_removed = [&](FrameId parent) { return tree.names.removed(parent); };
  if (forget_parents(tree.frames[id], is_removed)) increment(tree.edits[id]);
}

// Lists the removed frames that are past parents of a frame's samples, each once. Requires the
// topology mutex and the frame's write lock. Throws bad_alloc.
void list_removed_parents(const TreeState& tree, FrameId id, std::vector<FrameId>& parents) {
  const auto relaxed = std::memory_order_relaxed;
  parents.clear();
  const Frame& frame = tree.frames[id];
  const std::uint32_t count = frame.count.load(relaxed), first = frame.first.load(relaxed);
  if (count == 0 || frame.parent_changes.load(relaxed) == 0) return;
  const Ring ring = frame.ring.load(relaxed);
  FrameId last = 0;  // samples in a row mostly have one parent
  for (std::uint32_t i = 0; i < count; ++i) {
    const FrameId parent = ring.parent(first + i);
    if (parent != last && parent != 0 && tree.names.removed(parent)) parents.push_back(parent);
    last = parent;
  }
  std::sort(parents.begin(), parents.end());
  parents.erase(std::unique(parents.begin(), parents.end()), parents.end());
}

// The frames that refer to removed ones, with the versions that free_removed_names() gives them,
// and the parents that it takes from them: a mirror may have another view of what is removed, as it
// reads frames one after the other.
void log_orphans(const TreeState& tree, LogTicket& ticket, const WriteLocks& locks) {
  if (!ticket.wants_entry()) return;
  Version base = tree.version_base;
  for (const FrameId id : locks.frames())
    if (tree.names.removed(id)) base = std::max(base, locks.version_after(id));
  struct Orphan {
    FrameId id, lost;  // lost: 0 if only the version changes
  };
  std::vector<Orphan> orphans;
  std::map<FrameId, std::string> names;
  const auto add = [&](FrameId id, FrameId lost) {
    orphans.push_back({id, lost});
    for (const FrameId each : {id, lost})
      if (each != 0 && !names.contains(each)) names.emplace(each, tree.name(each));
  };
  std::vector<FrameId> lost;
  for (const FrameId id : locks.frames()) {
    if (tree.names.removed(id)) continue;
    list_removed_parents(tree, id, lost);
    if (lost.empty()) add(id, 0);
    for (const FrameId parent : lost) add(id, parent);
  }
  if (orphans.empty()) return ticket.changes_nothing();
  std::size_t bytes = 0;
  for (const auto& [id, name] : names) bytes += name.size();
  LogEntry* const entry = ticket.make_entry(orphans.size(), names.size(), bytes);
  if (!entry) return;
  std::map<FrameId, std::uint32_t> index;
  for (const auto& [id, name] : names) index.emplace(id, entry->add_name(name));
  for (const auto& [id, parent] : orphans)
    entry->add({ChangeKind::orphaned,
                index.at(id),
                parent == 0 ? kNoParent : index.at(parent),
                std::max(locks.version_after(id), base),
                0,
                {}});
}

}  // namespace

void free_removed_names(TreeState& tree) {
  if (tree.names.removed_names() == 0) return;
  LongWait::announce();
  // The records of all ids get a version below. Without memory on the host it is this that fails.
  tree.region.allocate_records(tree.names.max_size());
  FrameList frames;  // those without a name, and those that refer to one
  for (FrameId id = 1; id <= tree.names.size(); ++id)
    if (tree.names.removed(id) || refers_to_removed(tree, id)) frames.push_back(id);
  {
    LogTicket ticket(tree.change_log.get());
    WriteLocks locks(tree, frames);
    log_orphans(tree, ticket, locks);
    locks.begin_write();
    ticket.draw();
    for (const FrameId id : frames) {
      if (!tree.names.removed(id)) {
        forget_removed_parents(tree, id);
        continue;
      }
      tree.version_base = std::max(tree.version_base, locks.version_after(id));
      tree.events[id].forget_lookups();  // those counted since the removal, without its locks
      tree.names.expire_refs(id);
    }
    tree.event_log.forget([&](FrameId id) { return tree.names.removed(id); });
    tree.ids_freed.fetch_add(1, std::memory_order_seq_cst);
    locks.release_from(tree.version_base);
    ticket.publish();
  }
  // Few: no ids are freed while as many are left as the commit may need. No thread knows them.
  for (FrameId id = tree.names.size() + 1; id <= tree.names.max_size(); ++id)
    tree.frames[id].version.unlock_changed(tree.version_base);
  tree.names.free_removed();
}

// Authorities that are freed, so that others can take their places.
//
// All frames are locked meanwhile. A commit that has looked up an id before, and locks its frames
// afterwards, sees that ids_freed has changed, and looks it up again. No commit
// therefore stores the id of an authority that was freed.
void free_authorities(TreeState& tree) {
  FrameList all;
  tree.list_frames(all);
  // Readers continue, except those of a tree with one frame: its lock begins the write
  // (commits/write_locks.hpp).
  const WriteLocks locks(tree, all);

  const auto relaxed = std::memory_order_relaxed;
  std::vector<bool> owns(tree.authorities.size() + 1);
  for (const FrameId id : all)
    if (tree.frames[id].parent.load(relaxed) != 0)
      owns[tree.frames[id].authority.load(relaxed)] = true;

  std::vector<std::pair<std::uint64_t, AuthorityId>> idle;  // by last use
  for (AuthorityId id = 1; id <= tree.authorities.size(); ++id)
    if (!owns[id]) idle.emplace_back(tree.authority_counters.sum(id).last_used, id);
  std::sort(idle.begin(), idle.end());
  idle.resize(std::min<std::size_t>(idle.size(), (tree.authorities.size() + 1) / 2));
  if (idle.empty()) return;

  std::vector<bool> is_freed(tree.authorities.size() + 1);
  for (const auto& [last_used, id] : idle) is_freed[id] = true;
  // No word may keep an id that another authority will get.
  for (const FrameId id : all) {
    if (is_freed[tree.frames[id].authority.load(relaxed)])
      tree.frames[id].authority.store(0, std::memory_order_release);
    FrameEvents& events = tree.events[id];
    for (std::atomic<AuthorityId>* last :
         {&events.change_authority, &events.authority_before, &events.replaced_authority})
      if (is_freed[last->load(relaxed)]) last->store(0, std::memory_order_release);
  }
  tree.ids_freed.fetch_add(1, std::memory_order_seq_cst);
  for (const auto& [last_used, id] : idle) tree.authorities.free(id);
}

}  // namespace ztf
