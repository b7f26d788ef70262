// The execution of a commit's plan.
//
// Thread safety: lives on the writer's stack. Nothing here can fail: CommitPlan has reserved all
// memory.
#pragma once

#include "commit_plan.hpp"

namespace ztf {

class CommitExecution {
 public:
  CommitExecution(Tree& tree, const CommitPlan& plan) noexcept : tree_(tree), plan_(plan) {}

  // Makes room in the list of changed frames, so that apply() cannot fail. Throws bad_alloc.
  void reserve(const WriteLocks& locks);

  // Stores the plan's rows and publishes its names. Requires a ready plan, its write locks, and
  // that readers already wait (WriteLocks::begin_write).
  void apply(const WriteLocks& locks) noexcept;

  // The frames that get a new version when they are unlocked, ascending: all of them on the first
  // reparenting (CommitPlan::decide).
  [[nodiscard]] const FrameList& frames_with_new_version(const WriteLocks& locks) const noexcept {
    return plan_.is_first_reparenting() ? locks.frames() : changed_;
  }

  // Wakes the lookups that this commit may help. Requires that the locks are released and that the
  // commit is counted (wait_list.hpp). Allocates nothing: a commit that is done cannot fail.
  void notify_waiters() const noexcept;

 private:
  void clear_samples(const FrameList& all) noexcept;
  bool apply_group(const FrameWrites& group) noexcept;
  bool apply_rows(const FrameWrites& group) noexcept;
  void store_rows(const FrameWrites& group) noexcept;
  void record_link_change(const FrameWrites& group, FrameId parent_before,
                          bool static_before) noexcept;
  void count_authority() const noexcept;

  Tree& tree_;
  const CommitPlan& plan_;
  FrameList changed_;  // the frames that got or lost samples, ascending
  CommitTally tally_;
};

}  // namespace ztf
