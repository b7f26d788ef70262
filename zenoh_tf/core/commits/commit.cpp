// Commits: resolve, lock, validate, decide, apply.
#include <type_traits>

#include "commits/apply.hpp"

namespace ztf {

namespace {

// The LogTicket of a tree without a change log. With two instances of the code, a commit pays one
// predictable branch; four of them, in LogTicket, cost a commit of one row 4 %.
struct NoTicket {
  void draw() noexcept {}
  void publish() noexcept {}
};

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

}  // namespace

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
  const auto attempt = [&]<class Ticket>(Ticket& ticket) {
    // To lock all frames is long work in itself.
    if (scope == CommitScope::all_frames) LongWait::announce();
    std::unique_lock<std::mutex> topology;
    if (scope != CommitScope::children) topology = lock_announced(topology_);
    if (!plan.resolve_and_group(scope)) return PlanOutcome::needs_topology;

    FrameList all;
    if (scope == CommitScope::all_frames) plan.list_all_frames(all);
    WriteLocks locks(*this, scope == CommitScope::all_frames ? all : plan.children(),
                     plan.is_long());
    if (plan.has_read_set()) {
      locks.begin_write();
      ticket.draw();
      plan.validate_read_set(locks);
    }
    const LinksRestored restored(plan);
    if (const PlanOutcome outcome = plan.decide(scope); outcome != PlanOutcome::ready)
      return outcome;
    execution.reserve();
    if constexpr (std::is_same_v<Ticket, LogTicket>) execution.log(ticket, locks);
    plan.check_expiry();

    // At the latest here, readers wait. This is the linearization point (commits/write_locks.hpp).
    locks.begin_write();
    ticket.draw();
    execution.apply();
    locks.release(execution.frames_with_new_version(locks));
    ticket.publish();
    return PlanOutcome::ready;
  };
  if (change_log_) [[unlikely]] {
    LogTicket ticket(change_log_.get());
    return attempt(ticket);
  }
  NoTicket ticket;
  return attempt(ticket);
}

}  // namespace ztf
