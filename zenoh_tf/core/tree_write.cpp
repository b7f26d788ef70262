// Commits: resolve, lock, validate, decide, apply.
#include "commit_apply.hpp"

namespace ztf {

void Tree::commit(const CommitRequest& request, std::span<std::uint8_t> stored) {
  CommitPlan plan(*this, request, stored);
  CommitExecution execution(*this, plan);
  {
    const auto giant = lock_giant();
    CommitScope scope = plan.initial_scope();
    for (;;) {
      const PlanOutcome outcome = try_commit(plan, execution, scope);
      if (outcome == PlanOutcome::ready) break;
      scope =
          outcome == PlanOutcome::needs_topology ? CommitScope::topology : CommitScope::all_frames;
      count_retry();
    }
  }
  commit_count_.add();
  execution.notify_waiters();
}

// One attempt to commit. Returns `ready` if the commit is applied, else the scope that it needs.
// Throws Rejected and bad_alloc. Unless it returns `ready` it has changed nothing that others can
// see, and `stored` is unspecified.
PlanOutcome Tree::try_commit(CommitPlan& plan, CommitExecution& execution, CommitScope scope) {
  // To lock all frames is long work in itself.
  if (scope == CommitScope::all_frames) LongWait::announce();
  std::unique_lock<std::mutex> topology;
  if (scope != CommitScope::children) topology = lock_announced(topology_);
  if (!plan.resolve_and_group(scope)) return PlanOutcome::needs_topology;

  FrameList all;
  LogTicket ticket(change_log_.get());
  if (scope == CommitScope::all_frames) plan.list_all_frames(all);
  WriteLocks locks(*this, scope == CommitScope::all_frames ? all : plan.children(), plan.is_long());
  if (plan.has_read_set()) {
    locks.begin_write();
    ticket.draw();
    plan.validate_read_set(locks);
  }
  if (const PlanOutcome outcome = plan.decide(scope); outcome != PlanOutcome::ready) return outcome;
  execution.reserve();
  if (ticket.has_log()) [[unlikely]]
    execution.log(ticket, locks);
  plan.check_expiry();

  // At the latest here, readers wait. This is the linearization point (write_locks.hpp).
  locks.begin_write();
  ticket.draw();
  execution.apply();
  locks.release(execution.frames_with_new_version(locks));
  ticket.publish();
  return PlanOutcome::ready;
}

}  // namespace ztf
