// What commits write to the change log. Only trees that have a log come here.
#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "commits/apply.hpp"

namespace ztf {

namespace {

// Makes an entry of changes without data, one for each name.
void log_names(LogTicket& ticket, ChangeKind kind,
               const std::vector<std::pair<std::string, Version>>& frames) {
  if (frames.empty()) return ticket.changes_nothing();
  std::size_t bytes = 0;
  for (const auto& [name, version] : frames) bytes += name.size();
  LogEntry* const entry = ticket.make_entry(frames.size(), frames.size(), bytes);
  if (!entry) return;
  for (const auto& [name, version] : frames)
    entry->add({kind, entry->add_name(name), 0, version, 0, {}});
}

Version version_after(const WriteLocks& locks, FrameId id) noexcept {
  return *locks.version_before(id) + SeqLock::kIncrement;
}

// The version that a commit leaves to a frame which it creates only as a parent: the first
// reparenting gives all frames that it locks a new one, frames without a name included. Else it is
// that of CommitNames::publish().
Version version_of_created(const Frame& frame, FrameId id, const WriteLocks& locks,
                           bool all_change) noexcept {
  if (all_change && locks.version_before(id)) return version_after(locks, id);
  const Version now = frame.version.current() & ~SeqLock::kWriting;
  return now == 0 ? SeqLock::kIncrement : now;
}

}  // namespace

void CommitExecution::log(LogTicket& ticket, const WriteLocks& locks) const {
  if (!ticket.wants_entry()) return;
  const CommitRequest& request = plan_.request();
  const CommitNames& names = plan_.names();
  std::vector<std::pair<std::string_view, FrameId>> created;
  names.for_each_new([&](std::string_view name, FrameId id) {
    if (!plan_.group_of(id)) created.emplace_back(name, id);
  });
  std::vector<std::pair<std::string, Version>> others;  // that only get a new version
  if (plan_.is_first_reparenting())
    for (const FrameId id : locks.frames())
      if (!plan_.group_of(id) && !tree_.names_.hidden(id))
        others.emplace_back(tree_.name(id), version_after(locks, id));

  std::size_t changes = created.size() + others.size(), bytes = request.authority.size();
  for (const FrameWrites& group : plan_.groups())
    changes += group.end - group.begin + group.restarts + plan_.is_first_reparenting();
  const auto name_count = static_cast<std::uint32_t>(request.names.size());
  for (std::uint32_t i = 0; i < name_count; ++i) bytes += names.name(i).size();
  for (const auto& [name, id] : created) bytes += name.size();
  for (const auto& [name, version] : others) bytes += name.size();
  LogEntry* const entry =
      ticket.make_entry(changes, name_count + created.size() + others.size() + 1, bytes);
  if (!entry) return;

  for (std::uint32_t i = 0; i < name_count; ++i) entry->add_name(names.name(i));
  for (const auto& [name, id] : created) {
    const Version version =
        version_of_created(tree_.frames_[id], id, locks, plan_.is_first_reparenting());
    entry->add({ChangeKind::created, entry->add_name(name), 0, version, 0, {}});
  }
  for (const auto& [name, version] : others)
    entry->add({ChangeKind::new_version, entry->add_name(name), 0, version, 0, {}});
  if (!request.authority.empty()) entry->set_authority(entry->add_name(request.authority));
  const ChangeKind kind = request.is_static ? ChangeKind::static_link : ChangeKind::sample;
  for (const FrameWrites& group : plan_.groups()) {
    const std::uint32_t child = request.rows[plan_.write(group.begin).row].child;
    const Version version = version_after(locks, group.child);
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
  }
  if (entry->size() == 0) ticket.changes_nothing();
}

void Tree::log_clear(LogTicket& ticket, const WriteLocks& locks, bool keep_static) const {
  if (!ticket.wants_entry()) return;
  std::vector<std::pair<std::string, Version>> cleared;
  for (const FrameId id : locks.frames())
    if (is_cleared(id, keep_static)) cleared.emplace_back(name(id), version_after(locks, id));
  log_names(ticket, ChangeKind::cleared, cleared);
}

void Tree::log_removal(LogTicket& ticket, const WriteLocks& locks) const {
  if (!ticket.wants_entry()) return;
  std::vector<std::pair<std::string, Version>> removed;
  for (const FrameId id : locks.frames())
    if (!names_.hidden(id)) removed.emplace_back(name(id), version_after(locks, id));
  log_names(ticket, ChangeKind::removed, removed);
}

// The frames that refer to removed ones, with the versions that free_removed_names() gives them,
// and the parents that it takes from them: a mirror may have another view of what is removed, as it
// reads frames one after the other.
void Tree::log_orphans(LogTicket& ticket, const WriteLocks& locks) const {
  if (!ticket.wants_entry()) return;
  Version base = version_base_;
  for (const FrameId id : locks.frames())
    if (names_.hidden(id)) base = std::max(base, version_after(locks, id));
  struct Orphan {
    FrameId id, lost;  // lost: 0 if only the version changes
  };
  std::vector<Orphan> orphans;
  std::map<FrameId, std::string> names;
  const auto add = [&](FrameId id, FrameId lost) {
    orphans.push_back({id, lost});
    for (const FrameId each : {id, lost})
      if (each != 0 && !names.contains(each)) names.emplace(each, name(each));
  };
  std::vector<FrameId> lost;
  for (const FrameId id : locks.frames()) {
    if (names_.hidden(id)) continue;
    list_removed_parents(id, lost);
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
                std::max(version_after(locks, id), base),
                0,
                {}});
}

}  // namespace ztf
