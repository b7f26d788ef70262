// The execution of a commit's plan.
//
// Thread safety: lives on the writer's stack.
// Invariant: apply() and what follows cannot fail. reserve() comes first and may throw.
#pragma once

#include "commits/plan.hpp"

namespace ztf {

class CommitExecution {
 public:
  CommitExecution(TreeState& tree, CommitPlan& plan) noexcept : tree_(tree), plan_(plan) {}

  // Makes room in the list of changed frames, so that apply() allocates nothing. Requires a ready
  // plan. Throws bad_alloc.
  void reserve();

  // Fills the ticket's entry with what apply() is going to change (commits/log.cpp). Requires a
  // ready plan. Throws bad_alloc.
  void log(LogTicket& ticket, const WriteLocks& locks) const;

  // Stores the plan's rows and publishes its names. Requires reserve(), the write locks, and that
  // WriteLocks::begin_write() has been called. Names are no part of a reader's snapshot: they are
  // published one by one, so a lookup may find one new name and not yet another.
  void apply() noexcept;

  // True if the commit counts as one: a put of which apply() has stored no row does not.
  [[nodiscard]] bool counts_as_commit() const noexcept {
    return tally_.stored != 0 || !plan_.request().drop_bad;
  }

  // Returns the frames that get a new version when they are unlocked, ascending. These are the
  // changed frames; on the first reparenting all frames (CommitPlan::decide).
  [[nodiscard]] const FrameList& frames_with_new_version(const WriteLocks& locks) const noexcept {
    return plan_.is_first_reparenting() ? locks.frames() : changed_;
  }

  // Wakes the lookups whose result this commit may have changed. Requires that the locks are
  // released and that the commit is counted (waiting/wait_list.hpp). Allocates nothing, as a commit
  // that is done must not fail.
  void notify_waiters() const noexcept;

 private:
  void restart_history(const FrameWrites& group) noexcept;
  void record_time_jump(const FrameWrites& group, Stamp to) noexcept;
  bool apply_group(const FrameWrites& group) noexcept;
  bool apply_rows(const FrameWrites& group) noexcept;
  void store_rows(const FrameWrites& group) noexcept;
  void record_replacement(const FrameWrites& group, const Pose& before) noexcept;
  void record_link_change(const FrameWrites& group, FrameId parent_before, bool static_before,
                          const Pose& pose_before) noexcept;
  void count_authority() const noexcept;

  TreeState& tree_;
  CommitPlan& plan_;
  FrameList changed_;  // the frames that got or lost samples, ascending
  CommitTally tally_;
};

// Fills the ticket's entry with one change without data for each of these frames that has a name
// (commits/log.cpp). Requires the topology mutex and the frames' write locks, and that nothing is
// written yet. Throws bad_alloc.
void log_frames(const TreeState& tree, LogTicket& ticket, const WriteLocks& locks, ChangeKind kind,
                const FrameList& frames);

}  // namespace ztf
