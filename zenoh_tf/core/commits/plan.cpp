// How a commit is planned: resolve, sort, group, decide.
//
// Measured gains: prefetching the records takes a third off a commit of 16 links. Prefetching the
// rings and the names' slots (NameTable::find_each) takes another fifth. is_append() takes a third
// off a commit of one row.
#include "commits/plan.hpp"

#include <algorithm>

namespace ztf {

namespace {

// Returns a frame's version, whether or not readers already wait. Requires its write lock.
Version version_of(const Frame& frame) noexcept {
  return frame.version.current() & ~SeqLock::kWriting;
}

// Whether a frame's newest sample is so far in the future that its history is the one in error.
bool history_is_ahead_of_clock(Stamp newest, std::uint64_t ahead_ns) noexcept {
  timespec time{};
  (void)::clock_gettime(CLOCK_REALTIME, &time);
  const Stamp now = Stamp{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
  return newest > now && span_ns(now, newest) > ahead_ns;
}

}  // namespace

CommitPlan::CommitPlan(TreeState& tree, const CommitRequest& request,
                       std::span<std::uint8_t> stored)
    : tree_(tree),
      request_(request),
      stored_(stored),
      limits_{tree.options.cache_ns, tree.options.max_samples_per_frame},
      names_(tree, request) {
  const auto rows = static_cast<std::uint32_t>(request.rows.size());
  RowWrite* const writes = writes_.append(rows);
  RowWrite* write = writes;
  Pose* const poses = poses_.append(rows);
  for (std::uint32_t i = 0; i < rows; ++i) {
    const Row& row = request.rows[i];
    const FrameId child = names_.id(row.child), parent = names_.id(row.parent);
    *write++ = {child, parent, i, row.stamp};
    // The record arrives while the other rows are checked.
    if (rows > 1) tree.frames[child].prefetch_for_write();
    // Equal ids are one name, unless both are 0: then the names must be compared.
    if (!names_.all_valid() || child == parent) [[unlikely]]
      check_names(request, row, tree.options);
    check_values(request, row, poses[i]);
    // Only puts have a `max_stamp`: the server compares the stamps of calls itself.
    if (row.stamp > request.max_stamp && !request.is_static) [[unlikely]] {
      if (!request.drop_old) reject_future_stamp(request, row);
      stored[i] = RowResult::from_future;
      ++from_future_;
      --write;
    }
  }
  writes_.set_size(static_cast<std::size_t>(write - writes));
  check_authority(request, tree.options);
}

CommitScope CommitPlan::initial_scope() const noexcept {
  // Version 0 asserts that a frame does not exist. Only the topology mutex keeps that true.
  for (const Version version : request_.read_versions)
    if (version == 0) return CommitScope::topology;
  return CommitScope::children;
}

bool CommitPlan::resolve_and_group(CommitScope scope) {
  const bool may_add = scope != CommitScope::children;
  if (!names_.resolve(may_add)) return false;
  if (may_add) assign_new_ids();
  sort_rows();
  group_rows();
  // The rings arrive while the locks are taken.
  if (groups_.size() > 1)
    for (const FrameWrites& group : groups_) prefetch_history(*group.frame);
  return true;
}

// Assigns ids in the order of the rows, to the child before the parent, as tf2 does. A row of an
// existing child may yet be dropped, and must not create its parent then: decide_rows() creates it,
// once it knows. A row of a new child is always stored.
void CommitPlan::assign_new_ids() {
  std::sort(writes_.begin(), writes_.end(),
            [](const RowWrite& a, const RowWrite& b) { return a.row < b.row; });
  for (RowWrite& write : writes_) {
    const Row& row = request_.rows[write.row];
    const bool may_be_dropped = request_.drop_old && names_.id(row.child) != 0;
    write.child = names_.id_or_new(row.child);
    write.parent = may_be_dropped ? names_.id(row.parent) : names_.id_or_new(row.parent);
    // The constructor looked up both names without a lock. If one name appeared between the two
    // lookups, their ids differed there, although they are the same frame.
    if (write.child == write.parent) check_names(request_, row, tree_.options);
  }
}

void CommitPlan::sort_rows() {
  const auto before = [](const RowWrite& a, const RowWrite& b) {
    if (a.child != b.child) return a.child < b.child;
    return a.stamp != b.stamp ? a.stamp < b.stamp : a.row < b.row;
  };
  if (!std::is_sorted(writes_.begin(), writes_.end(), before))
    std::sort(writes_.begin(), writes_.end(), before);
}

void CommitPlan::group_rows() {
  if (prepared_rings_.size() != 0) give_back_rings();  // of an earlier attempt
  groups_.clear();
  children_.clear();
  FrameWrites* const groups = groups_.reserve(writes_.size());
  FrameId* const children = children_.reserve(writes_.size());
  std::size_t n = 0;
  for (std::uint32_t i = 0; i < writes_.size(); ++i) {
    const FrameId child = writes_[i].child;
    if (n == 0 || child != children[n - 1]) {
      groups[n] = FrameWrites{&tree_.frames[child], child, i, i};
      children[n++] = child;
    }
    groups[n - 1].end = i + 1;
  }
  groups_.set_size(n);
  children_.set_size(n);
}

void CommitPlan::list_all_frames(FrameList& all) const {
  tree_.list_frames(all);
  for (const FrameId child : children_)
    if (child > tree_.names.size()) all.push_back(child);  // created by this commit
}

void CommitPlan::validate_read_set(const WriteLocks& locks) const {
  for (std::size_t i = 0; i < request_.read_names.size(); ++i) {
    const FrameId id = tree_.names.find(request_.read_names[i]);
    const Version* const locked = id ? locks.version_before(id) : nullptr;
    const Version now = locked ? *locked : id ? tree_.frames[id].version.current() : 0;
    if (now != request_.read_versions[i]) reject_conflict(request_.read_names[i]);
  }
}

PlanOutcome CommitPlan::decide(CommitScope scope) {
  // With the topology mutex no id is freed.
  if (!names_.are_ids_current()) [[unlikely]]
    return PlanOutcome::needs_topology;
  is_first_reparenting_ = false;
  bool topology_changes = names_.any_new();
  for (FrameWrites& group : groups_) {
    group.is_append = is_append(group);
    if (group.is_append) [[likely]] {
      stored_[writes_[group.begin].row] = RowResult::stored;
      continue;
    }
    decide_rows(group);
    topology_changes |= group.stores_other_parent;
  }
  if (topology_changes) {
    if (scope == CommitScope::children) return PlanOutcome::needs_topology;
    change_links();
  }
  // While no frame was ever reparented, readers use one path for all times. The first reparenting
  // therefore gives every frame a new version, so that readers which relied on it must retry.
  if (is_first_reparenting_ && scope != CommitScope::all_frames)
    return PlanOutcome::needs_all_frames;
  reserve_memory();
  return PlanOutcome::ready;
}

// Returns true if the rows of a group show that its frame's history must start over at an earlier
// time (docs/explanation/clocks.md): they are all too old, and so was a sample before them that is
// a little older, with no good sample in between. Unless the options say so, only a history that
// ends ahead of the real-time clock restarts.
bool CommitPlan::restarts_history(const FrameWrites& group) const noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const Frame& frame = *group.frame;
  const Stamp stamp = writes_[group.end - 1].stamp, newest = frame.latest.stamp.load(relaxed);
  if (!too_old(stamp, newest, limits_.cache_ns)) return false;
  const FrameEvents& events = tree_.events[group.child];
  const Stamp late = events.late_stamp.load(relaxed);
  // Every good sample changes the version.
  const bool is_second = events.late_version.load(relaxed) == version_of(frame) && late < stamp &&
                         span_ns(late, stamp) <= limits_.cache_ns;
  return is_second &&
         (tree_.options.clear_on_time_jump || history_is_ahead_of_clock(newest, limits_.cache_ns));
}

// Records that the rows of a group are too old, so that the next ones may confirm a time jump.
void CommitPlan::record_late(const FrameWrites& group, Stamp newest) const noexcept {
  const auto relaxed = std::memory_order_relaxed;
  FrameEvents& events = tree_.events[group.child];
  const Stamp stamp = writes_[group.end - 1].stamp;
  events.late_stamp.store(stamp, relaxed);
  events.late_version.store(version_of(*group.frame), relaxed);
  tree_.event_log.add({.kind = TreeEvent::Kind::late,
                       .frame = group.child,
                       .authority = names_.authority(),
                       .stamp = stamp,
                       .newest = newest});
}

// Recognises the common case, for which decide_rows() is not needed.
bool CommitPlan::is_append(const FrameWrites& group) const noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const Frame& frame = *group.frame;
  const RowWrite& write = writes_[group.begin];
  return group.end - group.begin == 1 && !request_.is_static && frame.count.load(relaxed) > 0 &&
         frame.latest.stamp.load(relaxed) < write.stamp &&
         frame.parent.load(relaxed) == write.parent &&
         frame.authority.load(relaxed) == names_.authority();
}

// Decides which rows of a group are stored, and what they change.
void CommitPlan::decide_rows(FrameWrites& group) {
  const auto relaxed = std::memory_order_relaxed;
  const Frame& frame = *group.frame;
  const bool was_static = frame.is_static.load(relaxed);
  const FrameId parent_before = frame.parent.load(relaxed);
  if (parent_before != 0) check_authority_of(group);

  // The frame's newest sample, as it will be when the next row is applied.
  bool has_samples = !was_static && frame.count.load(relaxed) > 0;
  group.restarts = has_samples && !request_.is_static && restarts_history(group);
  has_samples &= !group.restarts;
  Stamp newest = frame.latest.stamp.load(relaxed);
  FrameId parent = parent_before;
  // Rows come by stamp, so those for which a full frame has no room come first.
  const bool is_full = has_samples && frame.count.load(relaxed) == limits_.max_samples;
  const Stamp oldest = is_full ? oldest_served_stamp(frame) : kNoStamp;
  group.wakes_all = request_.is_static || was_static || group.restarts;
  if (has_samples && !request_.is_static &&
      too_old(writes_[group.end - 1].stamp, newest, limits_.cache_ns))
    record_late(group, newest);
  for (std::uint32_t i = group.begin; i < group.end; ++i) {
    RowWrite& write = writes_[i];
    const RowFate fate = fate_of(write, has_samples, newest, oldest);
    stored_[write.row] = fate == RowFate::stored ? RowResult::stored : RowResult::dropped;
    if (fate != RowFate::stored) {
      if (!request_.drop_old) reject_stamp(write, fate, newest, oldest);
      continue;
    }
    if (write.parent == 0) write.parent = names_.id_or_new(request_.rows[write.row].parent);
    group.stores_other_parent |= write.parent != parent_before;
    group.wakes_all |= write.parent != parent || (has_samples && write.stamp <= newest);
    // If this row prunes the newest sample, it prunes all, so no second parent remains.
    if (!request_.is_static && has_samples && write.parent != parent &&
        !too_old(newest, write.stamp, limits_.cache_ns))
      is_first_reparenting_ |= !tree_.ever_reparented.load();
    if (!has_samples || request_.is_static || write.stamp >= newest) {
      newest = write.stamp;
      parent = write.parent;
      has_samples = true;
    }
  }
  group.new_parent = parent == parent_before ? 0 : parent;
}

// Decides one row. Requires the stamp of the newest sample, if there is one, and as
// `oldest_of_full` the oldest stamp of a full frame, else kNoStamp.
CommitPlan::RowFate CommitPlan::fate_of(const RowWrite& write, bool has_samples, Stamp newest,
                                        Stamp oldest_of_full) const noexcept {
  if (request_.is_static) return RowFate::stored;
  if (has_samples && too_old(write.stamp, newest, limits_.cache_ns)) return RowFate::too_old;
  return write.stamp < oldest_of_full ? RowFate::no_room : RowFate::stored;
}

void CommitPlan::check_authority_of(const FrameWrites& group) const {
  const AuthorityId authority = group.frame->authority.load(std::memory_order_relaxed);
  if (!tree_.options.one_authority_per_frame || authority == names_.authority()) return;
  reject(request_, request_.rows[writes_[group.begin].row], "authority",
         "the frame is published by " + quoted(tree_.authority(authority)) +
             ", and only one authority may publish a frame (one_authority_per_frame)");
}

void CommitPlan::reject_stamp(const RowWrite& write, RowFate fate, Stamp newest,
                              Stamp oldest) const {
  const Row& row = request_.rows[write.row];
  const std::string stamp = "the stamp " + std::to_string(write.stamp) + " ns is older than ";
  if (fate == RowFate::too_old)
    reject(request_, row, "stamp_ns",
           stamp + "the newest sample's, " + std::to_string(newest) +
               " ns, by more than the cache time of " + std::to_string(limits_.cache_ns) + " ns" +
               (tree_.options.clear_on_time_jump
                    ? "; if time was set back, a second, newer transform begins the frame's "
                      "history again (time_jump)"
                    : ""));
  reject(request_, row, "stamp_ns",
         stamp + "all samples of the frame, which is full: it has " +
             with_separators(limits_.max_samples) + " (max_samples_per_frame), from " +
             std::to_string(oldest) + " ns on");
}

// Whether prepare_ring() may have to copy the samples of a group's frame.
bool CommitPlan::may_copy_history(const FrameWrites& group) const noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const Frame& frame = *group.frame;
  const std::uint32_t count = frame.count.load(relaxed);
  return !request_.is_static && count != 0 &&
         (needs_larger_ring(frame, count, group.end - group.begin, limits_) ||
          writes_[group.begin].stamp <= frame.latest.stamp.load(relaxed));
}

void CommitPlan::reserve_memory() {
  names_.reserve();
  if (request_.is_static) return;
  for (FrameWrites& group : groups_) {
    const Frame& frame = *group.frame;
    const std::uint64_t kept = group.restarts ? 0 : frame.count.load(std::memory_order_relaxed);
    if (!group.is_append || needs_larger_ring(frame, kept, 1, limits_)) prepare_ring(group);
  }
}

// Prepares a new ring for a group that needs one.
void CommitPlan::prepare_ring(FrameWrites& group) {
  const Frame& frame = *group.frame;
  const auto list_samples = [&] {
    std::vector<NewSample> samples;
    for (std::uint32_t i = group.begin; i < group.end; ++i)
      if (const RowWrite& write = writes_[i]; is_stored(write.row))
        samples.push_back({write.stamp, write.parent, &poses_[write.row]});
    return samples;
  };
  try {
    (void)prepared_rings_.reserve(1);
    std::uint32_t stored = 0;
    Stamp oldest_new = kNoStamp;
    for (std::uint32_t i = group.end; i-- > group.begin;)
      if (is_stored(writes_[i].row)) ++stored, oldest_new = writes_[i].stamp;
    if (stored == 0) return;
    const PreparedRing prepared = ztf::prepare_ring(frame, group.restarts, stored, oldest_new,
                                                    list_samples, limits_, tree_.ring_arena);
    if (!prepared.ring) return;
    prepared_rings_.push_back(prepared);
  } catch (const RingArena::Full&) {
    reject_memory(request_, request_.rows[writes_[group.begin].row],
                  tree_.options.max_memory_bytes);
  }
  group.ring = static_cast<std::uint32_t>(prepared_rings_.size());
}

void CommitPlan::give_back_rings() noexcept {
  for (const PreparedRing& prepared : prepared_rings_)
    if (prepared.ring) prepared.ring.give_back(tree_.ring_arena);
  prepared_rings_.clear();
}

const FrameWrites* CommitPlan::group_of(FrameId child) const noexcept {
  const FrameId* const at = std::lower_bound(children_.begin(), children_.end(), child);
  return at != children_.end() && *at == child ? &groups_[at - children_.begin()] : nullptr;
}

}  // namespace ztf
