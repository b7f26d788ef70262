// How a commit is planned: resolve, sort, group, decide.
//
// Measured gains: prefetching the records takes a third off a commit of 16 links. Prefetching the
// rings and the names' slots (NameTable::find_each) takes another fifth. is_append() takes a third
// off a commit of one row.
#include "commits/plan.hpp"

#include <algorithm>

#include "commits/commit.hpp"

namespace ztf {

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
    std::uint8_t result = check_values(row, poses[i]);
    // Equal ids are one name, unless both are 0: then the names must be compared.
    if (!names_.all_valid() || child == parent) [[unlikely]] {
      const std::uint8_t by_names = check_names(request, row, tree.options);
      if (by_names != RowResult::stored) result = by_names;
    }
    // Only puts have a `max_stamp`: the server compares the stamps of calls itself.
    if (row.stamp > request.max_stamp && !request.is_static && result == RowResult::stored)
        [[unlikely]]
      result = RowResult::from_future;
    if (result != RowResult::stored) [[unlikely]] {
      refuse(i, result);
      from_future_ += result == RowResult::from_future;
      --write;
    }
  }
  writes_.set_size(static_cast<std::size_t>(write - writes));
  check_authority(request, tree.options);
}

// Records that a row is not stored, or throws Rejected if the request does not allow that.
void CommitPlan::refuse(std::uint32_t row, std::uint8_t result) {
  const bool may = result == RowResult::from_future ? request_.drop_old : request_.drop_bad;
  if (!may) throw rejection_of(tree_, request_, request_.rows[row], result);
  stored_[row] = result;
}

void CommitPlan::refuse_group(const FrameWrites& group, std::uint8_t result) {
  for (std::uint32_t i = group.begin; i < group.end; ++i) refuse(writes_[i].row, result);
  has_refused_groups_ = true;
}

// Removes the rows of refused groups, so that the next attempt plans without them.
PlanOutcome CommitPlan::remove_refused() noexcept {
  RowWrite* const end = std::remove_if(writes_.begin(), writes_.end(), [&](const RowWrite& write) {
    return RowResult::is_refusal(stored_[write.row]);
  });
  writes_.set_size(static_cast<std::size_t>(end - writes_.begin()));
  return PlanOutcome::rows_refused;
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
  RowWrite* kept = writes_.begin();
  for (RowWrite write : writes_) {
    const Row& row = request_.rows[write.row];
    const bool may_be_dropped = request_.drop_old && names_.id(row.child) != 0;
    if (request_.drop_bad && !names_.has_room(row.child, may_be_dropped ? row.child : row.parent)) {
      refuse(write.row, RowResult::frame_limit);
      continue;
    }
    write.child = names_.id_or_new(row.child);
    write.parent = may_be_dropped ? names_.id(row.parent) : names_.id_or_new(row.parent);
    // The constructor looked up both names without a lock. If one name appeared between the two
    // lookups, their ids differed there, although they are the same frame.
    if (write.child == write.parent) {
      refuse(write.row, RowResult::own_parent);
      continue;
    }
    *kept++ = write;
  }
  writes_.set_size(static_cast<std::size_t>(kept - writes_.begin()));
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
  has_refused_groups_ = false;
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
  if (has_refused_groups_) [[unlikely]]
    return remove_refused();
  if (topology_changes) {
    if (scope == CommitScope::children) return PlanOutcome::needs_topology;
    check_links();
    if (has_refused_groups_) [[unlikely]]
      return remove_refused();
  }
  // While no frame was ever reparented, readers use one path for all times. The first reparenting
  // therefore gives every frame a new version, so that readers which relied on it must retry.
  if (is_first_reparenting_ && scope != CommitScope::all_frames)
    return PlanOutcome::needs_all_frames;
  reserve_memory();
  return has_refused_groups_ ? remove_refused() : PlanOutcome::ready;
}

// Recognises the common case, for which decide_rows() is not needed.
bool CommitPlan::is_append(const FrameWrites& group) const noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const Frame& frame = *group.frame;
  const RowWrite& write = writes_[group.begin];
  const Stamp newest = frame.latest.stamp.load(relaxed);
  return group.end - group.begin == 1 && !request_.is_static && frame.count.load(relaxed) > 0 &&
         newest < write.stamp &&
         (!request_.drop_strays || span_ns(newest, write.stamp) <= limits_.cache_ns) &&
         frame.parent.load(relaxed) == write.parent &&
         frame.authority.load(relaxed) == names_.authority();
}

// Decides which rows of a group are stored, and what they change.
void CommitPlan::decide_rows(FrameWrites& group) {
  const auto relaxed = std::memory_order_relaxed;
  const Frame& frame = *group.frame;
  const bool was_static = frame.is_static.load(relaxed);
  const FrameId parent_before = frame.parent.load(relaxed);
  if (parent_before != 0 && tree_.options.one_authority_per_frame &&
      frame.authority.load(relaxed) != names_.authority())
    return refuse_group(group, RowResult::other_authority);

  // The frame's newest sample, as it will be when the next row is applied.
  bool has_samples = !was_static && frame.count.load(relaxed) > 0;
  Stamp newest = frame.latest.stamp.load(relaxed);
  const bool is_late = has_samples && !request_.is_static &&
                       too_old(writes_[group.end - 1].stamp, newest, limits_.cache_ns);
  group.restarts = is_late && restarts_history(group, newest);
  has_samples &= !group.restarts;
  bool may_be_strays = has_samples && !request_.is_static && request_.drop_strays;
  FrameId parent = parent_before;
  // Rows come by stamp, so those for which a full frame has no room come first.
  const bool is_full = has_samples && frame.count.load(relaxed) == limits_.max_samples;
  const Stamp oldest = is_full ? oldest_served_stamp(frame) : kNoStamp;
  group.wakes_all = request_.is_static || was_static || group.restarts;
  if (is_late && !group.restarts) record_late(group, newest);
  for (std::uint32_t i = group.begin; i < group.end; ++i) {
    RowWrite& write = writes_[i];
    if (!request_.frames.empty() && parent_before != 0 && write.parent != parent_before)
      reject(*NamedRequest(tree_, request_), request_.rows[write.row], "parent_frame",
             "the frame has another parent now");
    if (may_be_strays && write.stamp > newest && span_ns(newest, write.stamp) > limits_.cache_ns) {
      if (refuse_strays(group, i, newest)) break;
      may_be_strays = false;  // the others follow this one
    }
    const RowFate fate = fate_of(write, has_samples, newest, oldest);
    stored_[write.row] = fate == RowFate::stored ? RowResult::stored : RowResult::dropped;
    if (fate != RowFate::stored) {
      if (!request_.drop_old) reject_stamp(write, fate, newest, oldest);
      continue;
    }
    if (write.parent == 0 && !create_parent(write)) continue;
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

// Creates the parent of a row that will be stored. Returns false if the row is refused for that.
bool CommitPlan::create_parent(RowWrite& write) {
  const std::uint32_t name = request_.rows[write.row].parent;
  if (request_.drop_bad && !names_.has_room(name, name)) {
    stored_[write.row] = RowResult::frame_limit;
    return false;
  }
  write.parent = names_.id_or_new(name);
  return true;
}

// Decides one row. Requires the stamp of the newest sample, if there is one, and as
// `oldest_of_full` the oldest stamp of a full frame, else kNoStamp.
CommitPlan::RowFate CommitPlan::fate_of(const RowWrite& write, bool has_samples, Stamp newest,
                                        Stamp oldest_of_full) const noexcept {
  if (request_.is_static) return RowFate::stored;
  if (has_samples && too_old(write.stamp, newest, limits_.cache_ns)) return RowFate::too_old;
  return write.stamp < oldest_of_full ? RowFate::no_room : RowFate::stored;
}

void CommitPlan::reject_stamp(const RowWrite& write, RowFate fate, Stamp newest,
                              Stamp oldest) const {
  const NamedRequest named(tree_, request_);
  const Row& row = request_.rows[write.row];
  const std::string stamp = "the stamp " + std::to_string(write.stamp) + " ns is older than ";
  if (fate == RowFate::too_old)
    reject(*named, row, "stamp_ns",
           stamp + "the newest sample's, " + std::to_string(newest) +
               " ns, by more than the cache time of " + std::to_string(limits_.cache_ns) + " ns" +
               (tree_.options.clear_on_time_jump
                    ? "; if time was set back, a second, newer transform begins the frame's "
                      "history again (time_jump)"
                    : ""));
  reject(*named, row, "stamp_ns",
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
    return refuse_group(group, RowResult::memory_limit);
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
