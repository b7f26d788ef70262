// How a plan is applied: names, samples, counters, wake-ups.
//
// Measured gains: the second prefetch takes a fifth off a commit of 16 links beside a reader on
// another core. With count_authority() after the release a commit of one row took 5 % longer.
#include "commits/apply.hpp"

#include <algorithm>
#include <cmath>

#include "system/host.hpp"

namespace ztf {

namespace {

// Static values that differ by less, in metres and radians, are one value in other digits.
constexpr double kSameValue = 1e-6;

}  // namespace

void CommitExecution::reserve() { (void)changed_.reserve(plan_.groups().size()); }

void CommitExecution::apply() noexcept {
  // Readers may have taken these lines back since the plan prefetched them.
  if (plan_.groups().size() > 1)
    for (const FrameWrites& group : plan_.groups()) group.frame->prefetch_for_write();
  plan_.names().publish(plan_.children());
  for (const FrameWrites& group : plan_.groups())
    if (apply_group(group)) changed_.push_back(group.child);
  if (plan_.is_first_reparenting()) tree_.ever_reparented.store(true);
  tally_.commits = counts_as_commit();
  count_authority();
}

// Drops the frame's samples, as time was set back. The group's rows are stored next.
void CommitExecution::restart_history(const FrameWrites& group) noexcept {
  record_time_jump(group, plan_.write(group.begin).stamp);
  drop_samples(*group.frame);
}

void CommitExecution::record_time_jump(const FrameWrites& group, Stamp to) noexcept {
  FrameEvents& events = tree_.events[group.child];
  tree_.time_jumps.fetch_add(1);
  increment(events.time_jumps);
  events.jumped_at_ns.store(real_time_ns(), std::memory_order_release);
  const Stamp from = group.frame->latest.stamp.load(std::memory_order_relaxed);
  events.jumped_from.store(from, std::memory_order_release);
  events.jumped_ahead.store(to > from, std::memory_order_release);
  tree_.event_log.add({.kind = TreeEvent::Kind::time_jump,
                       .frame = group.child,
                       .authority = plan_.names().authority(),
                       .stamp = to,
                       .newest = from});
}

// Stores the group's rows. Returns whether the frame has changed.
bool CommitExecution::apply_group(const FrameWrites& group) noexcept {
  if (!group.is_append) [[unlikely]]
    return apply_rows(group);
  if (group.ring != 0) publish_ring(*group.frame, plan_.prepared_ring(group));
  const RowWrite& write = plan_.write(group.begin);
  insert(*group.frame, write.stamp, write.parent, plan_.pose(write.row), plan_.limits());
  ++tally_.stored;
  return true;
}

bool CommitExecution::apply_rows(const FrameWrites& group) noexcept {
  Frame& frame = *group.frame;
  const FrameId parent_before = frame.parent.load(std::memory_order_relaxed);
  const bool static_before = frame.is_static.load(std::memory_order_relaxed);
  const std::uint32_t stored_before = tally_.stored;
  const Pose pose_before = frame.latest.pose.load();
  if (group.restarts) restart_history(group);
  if (group.jumps_ahead) record_time_jump(group, plan_.write(group.end - 1).stamp);
  store_rows(group);
  if (tally_.stored == stored_before) return false;
  if (group.wakes_all) increment(tree_.edits[group.child]);
  if (static_before && group.new_parent == 0 && plan_.request().is_static)
    record_replacement(group, pose_before);
  record_link_change(group, parent_before, static_before, pose_before);
  return true;
}

void CommitExecution::store_rows(const FrameWrites& group) noexcept {
  FrameEvents& events = tree_.events[group.child];
  HistoryWriter history(*group.frame, group.ring != 0 ? &plan_.prepared_ring(group) : nullptr,
                        plan_.limits());
  for (std::uint32_t i = group.begin; i < group.end; ++i) {
    const RowWrite& write = plan_.write(i);
    const Pose& pose = plan_.pose(write.row);
    if (!plan_.is_stored(write.row)) {
      if (plan_.is_refused(write.row)) continue;
      increment(events.dropped);
      ++tally_.dropped;
      continue;
    }
    ++tally_.stored;
    if (plan_.request().is_static)
      set_static(*group.frame, write.stamp, write.parent, pose);
    else
      history.store(write.stamp, write.parent, pose);
  }
  if (const std::uint32_t rewritten = history.rewritten(); rewritten != 0) {
    events.rewritten.store(events.rewritten.load(std::memory_order_relaxed) + rewritten,
                           std::memory_order_release);
    tally_.rewritten += rewritten;
  }
}

// Records that a static link has another value than before, if it has. Requires that the frame has
// the authority that it had.
void CommitExecution::record_replacement(const FrameWrites& group, const Pose& before) noexcept {
  const Pose now = group.frame->latest.pose.load();
  const double moved = std::hypot(now.x - before.x, now.y - before.y, now.z - before.z);
  const double cosine =
      now.qx * before.qx + now.qy * before.qy + now.qz * before.qz + now.qw * before.qw;
  const double turned = 2 * std::acos(std::min(1.0, std::abs(cosine)));
  if (moved <= kSameValue && turned <= kSameValue) return;
  const auto release = std::memory_order_release;
  FrameEvents& events = tree_.events[group.child];
  increment(events.replaced);
  events.replaced_at_ns.store(real_time_ns(), release);
  events.replaced_m.store(static_cast<float>(moved), release);
  events.replaced_rad.store(static_cast<float>(turned), release);
  events.replaced_authority.store(group.frame->authority.load(std::memory_order_relaxed), release);
}

// Counts changes of the frame's link (another parent, authority or kind), and records the last one.
// A frame's first link is no change.
void CommitExecution::record_link_change(const FrameWrites& group, FrameId parent_before,
                                         bool static_before, const Pose& pose_before) noexcept {
  using Change = FrameEvents::Change;
  const auto release = std::memory_order_release;
  const AuthorityId authority = plan_.names().authority();
  const bool is_static = plan_.request().is_static;
  FrameEvents& events = tree_.events[group.child];
  Change change = Change::none;
  const auto record = [&](std::atomic<std::uint64_t>& counter, Change what) {
    increment(counter);
    change = what;
  };
  const bool had_data = parent_before != 0;
  const AuthorityId authority_before = group.frame->authority.load(std::memory_order_relaxed);
  if (authority_before != authority) {
    if (had_data) {
      record(events.authority_changes, Change::authority);
      ++tally_.conflicts;
      tree_.event_log.add({.kind = TreeEvent::Kind::conflict,
                           .frame = group.child,
                           .authority = authority,
                           .authority_before = authority_before});
    }
    group.frame->authority.store(authority, release);
  }
  if (had_data && static_before != is_static) record(events.switched, Change::switched);
  if (had_data && group.new_parent != 0) {
    record(events.reparented, Change::reparented);
    tree_.event_log.add({.kind = TreeEvent::Kind::reparented,
                         .frame = group.child,
                         .authority = authority,
                         .parent_before = parent_before});
  }
  if (change == Change::none) return;
  events.change.store(change, release);
  events.change_stamp.store(plan_.write(group.end - 1).stamp, release);
  events.change_authority.store(authority, release);
  events.parent_before.store(parent_before, release);
  events.static_before.store(static_before, release);
  events.authority_before.store(authority_before, release);
  events.pose_before.store(pose_before);
}

void CommitExecution::count_authority() const noexcept {
  const AuthorityId authority = plan_.names().authority();
  if (authority != 0) tree_.authority_counters.add(authority, tally_);
}

void CommitExecution::notify_waiters() const noexcept {
  WaitList& list = tree_.wait_list;
  if (list.size() == 0) [[likely]]
    return;
  for (const FrameId frame : changed_) {
    if (!list.has_waiters(frame)) continue;
    const FrameWrites* const group = plan_.group_of(frame);
    const bool only_appended = group && !group->wakes_all;
    list.notify_frame(frame, only_appended ? WaitList::Change::appended : WaitList::Change::other);
  }
  plan_.names().for_each_new([&](std::string_view name, FrameId) { list.notify_name(name); });
}

}  // namespace ztf
