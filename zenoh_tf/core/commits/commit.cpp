// Commits: resolve, lock, validate, decide, apply.
#include "commits/commit.hpp"

#include "commits/apply.hpp"

namespace ztf {

namespace {

// Restores the topology index at the end of an attempt that has not applied its plan.
class LinksRestored {
 public:
  explicit LinksRestored(CommitPlan& plan) noexcept : plan_(plan) {}
  ~LinksRestored() { plan_.undo_links(); }
  LinksRestored(const LinksRestored&) = delete;
  LinksRestored& operator=(const LinksRestored&) = delete;

 private:
  CommitPlan& plan_;
};

// One attempt to commit. Returns `ready` if the commit is applied, else the scope that it needs.
// Throws Rejected and bad_alloc. Unless it returns `ready` it has changed nothing that others can
// see, and `stored` is unspecified.
PlanOutcome try_commit(TreeState& tree, CommitPlan& plan, CommitExecution& execution,
                       CommitScope scope) {
  LogTicket ticket(tree.change_log.get());
  // To lock all frames is long work in itself.
  if (scope == CommitScope::all_frames) LongWait::announce();
  std::unique_lock<std::mutex> topology;
  if (scope != CommitScope::children) topology = lock_announced(tree.topology);
  if (!plan.resolve_and_group(scope)) return PlanOutcome::needs_topology;

  FrameList all;
  if (scope == CommitScope::all_frames) plan.list_all_frames(all);
  WriteLocks locks(tree, scope == CommitScope::all_frames ? all : plan.children(), plan.is_long());
  if (plan.has_read_set()) {
    locks.begin_write();
    ticket.draw();
    plan.validate_read_set(locks);
  }
  const LinksRestored restored(plan);
  if (const PlanOutcome outcome = plan.decide(scope); outcome != PlanOutcome::ready) return outcome;
  execution.reserve();
  execution.log(ticket, locks);
  plan.check_expiry();

  // At the latest here, readers wait. This is the linearization point (commits/write_locks.hpp).
  locks.begin_write();
  ticket.draw();
  execution.apply();
  locks.release(execution.frames_with_new_version(locks));
  ticket.publish();
  return PlanOutcome::ready;
}

}  // namespace

void commit(TreeState& tree, const CommitRequest& request, std::span<std::uint8_t> stored) {
  CommitPlan plan(tree, request, stored);
  CommitExecution execution(tree, plan);
  {
    const auto transaction = lock_transaction(tree);
    CommitScope scope = plan.initial_scope();
    for (;;) {
      const PlanOutcome outcome = try_commit(tree, plan, execution, scope);
      if (outcome == PlanOutcome::ready) break;
      scope =
          outcome == PlanOutcome::needs_topology ? CommitScope::topology : CommitScope::all_frames;
      count_retry();
    }
  }
  tree.commit_count.add();
  execution.notify_waiters();
}

}  // namespace ztf
