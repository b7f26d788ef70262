// What commits write to the change log, if the tree has one. Declared in apply.hpp.
#include <utility>
#include <vector>

#include "commits/apply.hpp"

namespace ztf {

namespace {

// The version that a commit leaves to a frame which it creates only as a parent: the first
// reparenting gives all frames that it locks a new one, frames without a name included. Else it is
// that of CommitNames::publish().
Version version_of_created(const Frame& frame, FrameId id, const WriteLocks& locks,
                           bool all_change) noexcept {
  if (all_change && locks.version_before(id)) return locks.version_after(id);
  const Version now = frame.version.current() & ~SeqLock::kWriting;
  return now == 0 ? next_version(0) : now;
}

}  // namespace

void CommitExecution::log(LogTicket& ticket, const WriteLocks& locks) const {
  if (!ticket.wants_entry()) return;
  const NamedRequest named(tree_, plan_.request());
  const CommitRequest& request = *named;
  const CommitNames& names = plan_.names();
  std::vector<std::pair<std::string_view, FrameId>> created;
  names.for_each_new([&](std::string_view name, FrameId id) {
    if (!plan_.group_of(id)) created.emplace_back(name, id);
  });
  std::vector<std::pair<std::string, Version>> others;  // that only get a new version
  if (plan_.is_first_reparenting())
    for (const FrameId id : locks.frames())
      if (!plan_.group_of(id) && !tree_.names.removed(id))
        others.emplace_back(tree_.name(id), locks.version_after(id));

  std::size_t changes = created.size() + others.size(), bytes = request.authority.size();
  for (const FrameWrites& group : plan_.groups())
    changes += group.end - group.begin + group.restarts + plan_.is_first_reparenting();
  const auto name_count = static_cast<std::uint32_t>(request.names.size());
  for (const std::string_view name : request.names) bytes += name.size();
  for (const auto& [name, id] : created) bytes += name.size();
  for (const auto& [name, version] : others) bytes += name.size();
  LogEntry* const entry =
      ticket.make_entry(changes, name_count + created.size() + others.size() + 1, bytes);
  if (!entry) return;

  for (const std::string_view name : request.names) entry->add_name(stripped(name));
  for (const auto& [name, id] : created) {
    const Version version =
        version_of_created(tree_.frames[id], id, locks, plan_.is_first_reparenting());
    entry->add({ChangeKind::created, entry->add_name(name), 0, version, 0, {}});
  }
  for (const auto& [name, version] : others)
    entry->add({ChangeKind::new_version, entry->add_name(name), 0, version, 0, {}});
  if (!request.authority.empty()) entry->set_authority(entry->add_name(request.authority));
  const ChangeKind kind = request.is_static ? ChangeKind::static_link : ChangeKind::sample;
  for (const FrameWrites& group : plan_.groups()) {
    const std::uint32_t child = request.rows[plan_.write(group.begin).row].child;
    const Version version = locks.version_after(group.child);
    bool is_first = true;
    for (std::uint32_t i = group.begin; i < group.end; ++i) {
      const RowWrite& write = plan_.write(i);
      if (!plan_.is_stored(write.row)) continue;
      if (is_first && plan_.is_first_reparenting())
        entry->add({ChangeKind::new_version, child, 0, version, 0, {}});
      if (is_first && group.restarts) entry->add({ChangeKind::cleared, child, 0, version, 0, {}});
      is_first = false;
      entry->add({kind, child, request.rows[write.row].parent, version, write.stamp,
                  plan_.pose(write.row)});
    }
    // A frame whose rows are all dropped gets the new version nevertheless.
    if (is_first && plan_.is_first_reparenting())
      entry->add({ChangeKind::new_version, child, 0, version, 0, {}});
  }
  if (entry->size() == 0) ticket.changes_nothing();
}

void log_frames(const TreeState& tree, LogTicket& ticket, const WriteLocks& locks, ChangeKind kind,
                const FrameList& frames) {
  if (!ticket.wants_entry()) return;
  std::vector<std::pair<std::string, Version>> changed;
  std::size_t bytes = 0;
  for (const FrameId id : frames) {
    if (tree.removed(id)) continue;
    changed.emplace_back(tree.name(id), locks.version_after(id));
    bytes += changed.back().first.size();
  }
  if (changed.empty()) return ticket.changes_nothing();
  LogEntry* const entry = ticket.make_entry(changed.size(), changed.size(), bytes);
  if (!entry) return;
  for (const auto& [name, version] : changed)
    entry->add({kind, entry->add_name(name), 0, version, 0, {}});
}

}  // namespace ztf
