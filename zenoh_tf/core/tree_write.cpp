// Commits: everything is checked before the first write.
#include <algorithm>

#include "commit_names.hpp"
#include "commit_validation.hpp"
#include "history_insert.hpp"
#include "write_locks.hpp"

namespace ztf {

// One commit on its way: checked and put in order, locked, applied.
class Commit {
 public:
  Commit(Tree& tree, const CommitRequest& request, std::span<std::uint8_t> stored)
      : tree_(tree), request_(request), stored_(stored), names_(tree, request) {
    RowWrite* const writes = writes_.append(request.rows.size());
    Pose* const poses = poses_.append(request.rows.size());
    const bool several = request.rows.size() > 1;
    for (std::uint32_t i = 0; i < request.rows.size(); ++i) {
      const Row& row = request.rows[i];
      const FrameId child = names_.id(row.child), parent = names_.id(row.parent);
      writes[i] = {child, parent, i, row.stamp};
      if (several) tree.frames_[child].prefetch_for_write();
      // One name has one id; and two that are new may be one.
      if (!names_.all_valid() || child == parent) [[unlikely]]
        check_names(request, row, tree.options_);
      check_values(request, row, poses[i]);
    }
    check_authority(request, tree.options_);
  }

  void run() {
    // Version 0: the frame did not exist, and only who holds the topology can say that it still
    // does not.
    for (const Version version : request_.read_versions) needs_topology_ |= version == 0;
    while (!attempt()) {
      needs_topology_ = true;
      count_retry();
    }
  }

  // Once it is counted.
  void notify_waiters() const {
    WaitList& list = tree_.wait_list_;
    if (list.size() == 0) [[likely]]
      return;
    for (const FrameId frame : changed_) {
      if (!tree_.has_waiters(frame)) continue;
      const FrameWrites* const group = group_of(frame);
      list.notify_frame(frame, group ? group->change : WaitList::Change::other);
    }
    names_.for_each_new([&](std::string_view name, FrameId) { list.notify_name(name); });
  }

 private:
  struct RowWrite {
    FrameId child, parent;
    std::uint32_t row;
    Stamp stamp;
  };
  struct FrameWrites {  // the writes of one child: writes_[begin, end)
    Frame* frame;
    FrameId child;
    std::uint32_t begin, end;
    FrameId new_parent = 0;  // of the newest link after this commit; 0: as before
    WaitList::Change change = WaitList::Change::appended;
    bool is_append = false;  // one row, which changes nothing but what is the newest sample
  };

  // False: again, with the topology mutex held, for the topology or the names change; and with all
  // frames locked, where time was set back, or a frame will be the first of two parents.
  bool attempt() {
    std::unique_lock topology(tree_.topology_, std::defer_lock);
    if (needs_topology_) topology.lock();
    if (!names_.start(needs_topology_)) return false;
    if (needs_topology_) assign_new_ids();
    sort_and_group();
    if (needs_all_frames()) [[unlikely]]
      return commit_with_all_frames();
    prefetch_frames();
    prefetch_rings();
    WriteLocks locks(tree_, children_);
    if (!prepare(locks)) return false;
    write(locks);
    count_authority();  // before the release: after it a set took 5 % longer
    locks.release(changed_);
    return true;
  }

  // Where time was set back, all samples go in this same commit. And the first that leaves a frame
  // with samples of two parents is a change of all frames: who relied on that there was none finds
  // its frames changed (Reader::never_reparented()).
  [[nodiscard]] bool needs_all_frames() const noexcept {
    return time_jumped_ || first_of_two_parents_;
  }

  [[gnu::noinline]] bool commit_with_all_frames() {
    FrameList all;
    tree_.list_frames(all);
    for (const FrameId child : children_)
      if (child > tree_.names_.size()) all.push_back(child);  // that this commit creates
    WriteLocks locks(tree_, all);
    clears_samples_ = time_jumped_ && time_jumped_back();
    if (!prepare(locks)) return false;
    (void)changed_.reserve(all.size() + groups_.size());
    locks.begin_write();
    if (clears_samples_) {  // nothing can fail from here on
      tree_.time_jumps_.fetch_add(1);
      tree_.drop_samples(all, true, changed_);
    }
    write(locks);
    std::ranges::sort(changed_);
    const auto repeated = std::ranges::unique(changed_);
    changed_.set_size(changed_.size() - repeated.size());
    if (first_of_two_parents_) tree_.ever_reparented_.store(true);
    locks.release(first_of_two_parents_ ? all : changed_);
    count_authority();
    return true;
  }

  // Those that are new, in the order of their rows; tf2 numbers the child before the parent.
  void assign_new_ids() {
    std::ranges::sort(writes_, {}, &RowWrite::row);
    for (RowWrite& write : writes_) {
      const Row& row = request_.rows[write.row];
      write.child = names_.number(row.child);
      write.parent = names_.number(row.parent);
    }
  }

  // The lines that readers have taken back since: all at once, instead of one after the other where
  // they are stored to.
  void prefetch_frames() const noexcept {
    if (groups_.size() > 1)
      for (const FrameWrites& group : groups_) group.frame->prefetch_for_write();
  }

  // Before the locks, so that they come while these are taken: what another writer changes
  // meanwhile makes the wrong lines come.
  void prefetch_rings() const noexcept {
    if (groups_.size() > 1)
      for (const FrameWrites& group : groups_) prefetch_for_write(*group.frame);
  }

  // Refuses, or decides all that write() will do, which then cannot fail.
  bool prepare(WriteLocks& locks) {
    if (!request_.read_names.empty()) locks.begin_write();
    if (!validate_read_set(locks)) reject_conflict(request_.read_names[conflict_]);
    const bool held_all = needs_all_frames(), jumped = time_jumped_;
    first_of_two_parents_ = false;  // check_group() decides again
    bool topology_changes = names_.any_new();
    for (FrameWrites& group : groups_) {
      topology_changes |= check_group(group);
      if (jumped != time_jumped_) return false;
    }
    if (topology_changes) {
      if (!needs_topology_) return false;
      check_cycles();
    }
    if (first_of_two_parents_ && !held_all) return false;
    names_.reserve();
    (void)changed_.reserve(groups_.size());
    if (!request_.is_static)
      for (const FrameWrites& group : groups_)
        if (!group.is_append)
          reserve(*group.frame, group.end - group.begin, limits(), tree_.ring_arena_);
    return true;
  }

  void write(WriteLocks& locks) noexcept {
    prefetch_frames();
    locks.begin_write();
    names_.publish(children_);
    FrameId* changed = changed_.end();
    for (FrameWrites& group : groups_)
      if (group.is_append ? append(group) : apply(group)) *changed++ = group.child;
    changed_.set_size(static_cast<std::size_t>(changed - changed_.begin()));
  }

  void sort_and_group() {
    const auto before = [](const RowWrite& a, const RowWrite& b) {
      if (a.child != b.child) return a.child < b.child;
      return a.stamp != b.stamp ? a.stamp < b.stamp : a.row < b.row;
    };
    if (!std::is_sorted(writes_.begin(), writes_.end(), before))
      std::sort(writes_.begin(), writes_.end(), before);
    groups_.clear();
    children_.clear();
    FrameWrites* const groups = groups_.reserve(writes_.size());
    FrameId* const children = children_.reserve(writes_.size());
    std::size_t n = 0;
    for (std::uint32_t i = 0; i < writes_.size(); ++i) {
      const FrameId child = writes_[i].child;
      if (n == 0 || child != children[n - 1]) {
        groups[n] = FrameWrites{&tree_.frames_[child], child, i, i};
        children[n++] = child;
      }
      groups[n - 1].end = i + 1;
    }
    groups_.set_size(n);
    children_.set_size(n);
  }

  // Others may have dropped the samples meanwhile, and stored newer ones: those stay.
  [[nodiscard]] bool time_jumped_back() const noexcept {
    const auto relaxed = std::memory_order_relaxed;
    for (const FrameWrites& group : groups_) {
      const Frame& frame = *group.frame;
      if (!frame.is_static.load(relaxed) && frame.count.load(relaxed) > 0 &&
          too_old(writes_[group.begin].stamp, frame.latest.stamp.load(relaxed),
                  tree_.options_.cache_ns))
        return true;
    }
    return false;
  }

  // Whether the frame's link is one that goes before this commit's rows come.
  [[nodiscard]] bool will_be_cleared(const Frame& frame) const noexcept {
    return clears_samples_ && !frame.is_static.load(std::memory_order_relaxed);
  }

  // Under the write locks: does everything that was read still stand? Versions of frames
  // outside the write set are loaded after readers were held off from all that is in it, so
  // two commits that each read what the other writes cannot both pass.
  bool validate_read_set(const WriteLocks& locks) {
    for (std::size_t i = 0; i < request_.read_names.size(); ++i) {
      const FrameId id = tree_.names_.find(request_.read_names[i]);
      const Version read = request_.read_versions[i];
      const Version* own = id ? locks.version_before(id) : nullptr;
      if (own ? *own != read : id ? tree_.frames_[id].version.load() != read : read != 0) {
        conflict_ = i;
        return false;
      }
    }
    return true;
  }

  // Decides which rows are stored; true where the newest parent changes.
  bool check_group(FrameWrites& group) {
    const RowWrite& first = writes_[group.begin];
    group.is_append = group.end - group.begin == 1 && !request_.is_static && !clears_samples_ &&
                      is_append(*group.frame, first.stamp, first.parent, limits()) &&
                      group.frame->authority.load(std::memory_order_relaxed) == names_.authority();
    if (!group.is_append) [[unlikely]]
      return check_rows(group);
    stored_[first.row] = true;
    return false;
  }

  [[gnu::noinline]] bool check_rows(FrameWrites& group) {
    const Frame& frame = *group.frame;
    const auto relaxed = std::memory_order_relaxed;
    const bool goes = will_be_cleared(frame);
    const std::uint32_t authority = frame.authority.load(relaxed);
    const FrameId before = goes ? 0 : frame.parent.load(relaxed);
    if (tree_.options_.one_authority_per_frame && authority != names_.authority() && before != 0)
      reject(request_, request_.rows[writes_[group.begin].row], "authority",
             "the frame is published by " + quoted(tree_.authority(authority)));

    bool has_newest = !goes && !frame.is_static.load(relaxed) && frame.count.load(relaxed) > 0;
    Stamp newest = frame.latest.stamp.load(relaxed);
    FrameId parent = before;
    // Rows come by stamp, so what a full frame has no room for comes first.
    const bool is_full =
        has_newest && frame.count.load(relaxed) == tree_.options_.max_samples_per_frame;
    const Stamp oldest = oldest_stamp(frame);
    bool moves = false, has_two_parents = false;
    for (std::uint32_t i = group.begin; i < group.end; ++i) {
      const RowWrite& write = writes_[i];
      const bool old = !request_.is_static && has_newest &&
                       too_old(write.stamp, newest, tree_.options_.cache_ns);
      const bool no_room = !request_.is_static && is_full && write.stamp < oldest;
      if (old && tree_.options_.clear_on_time_jump) {
        time_jumped_ = true;
        return false;
      }
      if ((old || no_room) && !request_.drop_old)
        reject(request_, request_.rows[write.row], "stamp_ns",
               "the stamp " + std::to_string(write.stamp) +
                   (old ? " is older than the newest one, " + std::to_string(newest) +
                              ", by more than the cache time"
                        : " is older than all samples of a frame that is full"));
      stored_[write.row] = !(old || no_room);
      if (old || no_room) continue;
      // Also where a later row moves it back: while the rows are applied, one after
      // the other, nobody else may follow the newest parents. And also in the past:
      // only under the topology mutex is it sure that the parent is not removed.
      moves |= write.parent != before;
      // But for a newest one so old that this row prunes it, and with it all that came before.
      has_two_parents |= !request_.is_static && has_newest && write.parent != parent &&
                         !too_old(newest, write.stamp, tree_.options_.cache_ns);
      if (!has_newest || request_.is_static || write.stamp >= newest) {
        newest = write.stamp;
        parent = write.parent;
        has_newest = true;
      }
    }
    if (has_two_parents && !tree_.ever_reparented_.load()) first_of_two_parents_ = true;
    group.new_parent = parent == before ? 0 : parent;
    return moves;
  }

  // Would the newest parents, with all of this commit's at once, close a cycle?
  void check_cycles() const {
    const std::uint64_t frames = names_.frame_count_after();
    FrameList new_parents;
    for (const FrameWrites& group : groups_)
      if (group.new_parent != 0) new_parents.push_back(group.new_parent);
    std::sort(new_parents.begin(), new_parents.end());
    for (const FrameWrites& group : groups_) {
      if (group.new_parent == 0) continue;
      const FrameId child = group.child;
      FrameId frame = group.new_parent;
      // A frame that nobody stands on cannot be reached from below.
      if (!group.frame->is_parent.load(std::memory_order_relaxed) &&
          !std::binary_search(new_parents.begin(), new_parents.end(), child))
        continue;
      for (std::uint64_t steps = 0; frame != 0 && frame != child && steps <= frames; ++steps)
        frame = parent_after(frame);
      if (frame != 0)
        reject(request_, request_.rows[writes_[group.begin].row], "parent_frame",
               "it would close a cycle");
    }
  }
  [[nodiscard]] FrameId parent_after(FrameId id) const noexcept {
    if (const FrameWrites* const group = group_of(id); group && group->new_parent != 0)
      return group->new_parent;
    const Frame& frame = tree_.frames_[id];
    return will_be_cleared(frame) ? 0 : frame.parent.load(std::memory_order_relaxed);
  }

  bool append(const FrameWrites& group) noexcept {
    const RowWrite& write = writes_[group.begin];
    ztf::append(*group.frame, write.stamp, poses_[write.row], limits());
    ++tally_.stored;
    return true;
  }

  [[gnu::noinline]] bool apply(FrameWrites& group) {
    Frame& frame = *group.frame;
    FrameEvents& events = tree_.events_[group.child];
    const auto relaxed = std::memory_order_relaxed;

    const FrameId parent_before = frame.parent.load(relaxed);
    const bool static_before = frame.is_static.load(relaxed);
    const std::uint32_t stored_before = tally_.stored;
    for (std::uint32_t i = group.begin; i < group.end; ++i) {
      const RowWrite& write = writes_[i];
      if (!stored_[write.row]) {
        increment(events.dropped);
        ++tally_.dropped;
        continue;
      }
      ++tally_.stored;
      if (frame.is_static.load(relaxed) || frame.parent.load(relaxed) != write.parent ||
          frame.latest.stamp.load(relaxed) >= write.stamp || request_.is_static)
        group.change = WaitList::Change::other;
      if (request_.is_static) {
        set_static(frame, write.stamp, write.parent, poses_[write.row]);
        continue;
      }
      // Never refused: check_group() has seen to it.
      if (insert(frame, write.stamp, write.parent, poses_[write.row], limits()) ==
          InsertResult::replaced) {
        increment(events.rewritten);
        ++tally_.rewritten;
      }
    }
    if (tally_.stored == stored_before) return false;
    if (group.new_parent != 0) tree_.frames_[group.new_parent].is_parent.store(true, relaxed);
    if (frame.authority.load(relaxed) != names_.authority() || group.new_parent != 0 ||
        static_before != request_.is_static) [[unlikely]]
      record_link_change(group, parent_before, static_before);
    return true;
  }

  // Who changed what a link is, and what it was before.
  void record_link_change(const FrameWrites& group, FrameId parent_before,
                          bool static_before) noexcept {
    using Change = FrameEvents::Change;
    const auto relaxed = std::memory_order_relaxed;
    Frame& frame = *group.frame;
    FrameEvents& events = tree_.events_[group.child];
    Change change = Change::none;
    const auto note = [&](std::atomic<std::uint32_t>& counter, Change what) {
      increment(counter);
      change = what;
    };
    const bool had_data = parent_before != 0;
    if (frame.authority.load(relaxed) != names_.authority()) {
      if (had_data) {
        note(events.authority_changes, Change::authority);
        ++tally_.conflicts;
      }
      frame.authority.store(names_.authority(), std::memory_order_release);
    }
    if (had_data && static_before != request_.is_static) note(events.switched, Change::switched);
    if (had_data && group.new_parent != 0) note(events.reparented, Change::reparented);
    if (change == Change::none) return;
    events.change.store(change, std::memory_order_release);
    events.change_stamp.store(writes_[group.end - 1].stamp, std::memory_order_release);
    events.change_authority.store(names_.authority(), std::memory_order_release);
    events.parent_before.store(parent_before, std::memory_order_release);
    events.static_before.store(static_before, std::memory_order_release);
  }

  void count_authority() const noexcept {
    if (names_.authority() == 0) return;
    tree_.authority_counters_.add(names_.authority(), tally_, writes_.size() == 1);
  }

  // The rows of a frame, or null.
  [[nodiscard]] const FrameWrites* group_of(FrameId child) const noexcept {
    const FrameId* const at = std::lower_bound(children_.begin(), children_.end(), child);
    return at != children_.end() && *at == child ? &groups_[at - children_.begin()] : nullptr;
  }
  [[nodiscard]] HistoryLimits limits() const noexcept {
    return {tree_.options_.cache_ns, tree_.options_.max_samples_per_frame};
  }

  Tree& tree_;
  const CommitRequest& request_;
  const std::span<std::uint8_t> stored_;
  CommitNames names_;
  bool needs_topology_ = false;
  bool time_jumped_ = false;           // a row is too old, and that means that time was set back
  bool clears_samples_ = false;        // this attempt drops all samples first
  bool first_of_two_parents_ = false;  // no frame has ever had samples of two parents; one will
  std::size_t conflict_ = 0;
  SmallVector<RowWrite, 16> writes_;
  SmallVector<Pose, 16> poses_;  // of the rows, normalised
  SmallVector<FrameWrites, 16> groups_;
  FrameList children_;  // of groups_, ascending, as all lists of frames here
  FrameList changed_;   // those that got samples, or lost theirs
  CommitTally tally_;
};

void Tree::commit(const CommitRequest& request, std::span<std::uint8_t> stored) {
  Commit commit(*this, request, stored);
  {
    std::unique_lock giant(giant_, std::defer_lock);
    if (options_.concurrency == Concurrency::giant) giant.lock();
    commit.run();
  }
  count_.add();
  commit.notify_waiters();
}

}  // namespace ztf
