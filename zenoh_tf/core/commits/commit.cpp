// Commits: resolve, lock, validate, decide, apply.
#include "commits/commit.hpp"

#include "commits/apply.hpp"
#include "commits/validation.hpp"

namespace ztf {

namespace {

// One attempt to commit. Returns `ready` if the commit is applied, else the scope that it needs.
// Throws Rejected and bad_alloc. Unless it returns `ready` it has changed nothing that others can
// see but what planning may (commits/plan.hpp), and `stored` is unspecified.
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
  if (plan.from_future() != 0)
    tree.from_future.fetch_add(plan.from_future(), std::memory_order_relaxed);
  if (plan.has_no_rows_left()) return;
  CommitExecution execution(tree, plan);
  {
    const auto transaction = lock_transaction(tree);
    CommitScope scope = plan.initial_scope();
    for (;;) {
      const PlanOutcome outcome = try_commit(tree, plan, execution, scope);
      if (outcome == PlanOutcome::ready) break;
      if (outcome == PlanOutcome::needs_topology) scope = CommitScope::topology;
      if (outcome == PlanOutcome::needs_all_frames) scope = CommitScope::all_frames;
      count_retry();
    }
  }
  if (execution.counts_as_commit()) tree.commit_count.add();
  execution.notify_waiters();
}

Rejected rejection_of(const TreeState& tree, const CommitRequest& given, const Row& row,
                      std::uint8_t result) {
  const NamedRequest named(tree, given);
  const CommitRequest& request = *named;
  switch (result) {
    case RowResult::other_authority: {
      const FrameId child = tree.names.find(stripped(request.names[row.child]));
      const AuthorityId authority =
          child != 0 ? tree.frames[child].authority.load(std::memory_order_relaxed) : 0;
      return rejection(request, row, "authority",
                       "the frame is published by " + quoted(tree.authority(authority)) +
                           ", and only one authority may publish a frame "
                           "(one_authority_per_frame)");
    }
    case RowResult::cycle:
      return rejection(request, row, "parent_frame",
                       "the link would close a cycle: " + quoted(shown(request.names[row.parent])) +
                           " is below " + quoted(shown(request.names[row.child])));
    case RowResult::too_deep: {
      Rejected rejected =
          rejection(request, row, "max_depth",
                    "it would be more than " + with_separators(tree.options.max_depth) +
                        " links below its root (max_depth)");
      rejected.code = Code::limit;
      rejected.limit = tree.options.max_depth;
      return rejected;
    }
    case RowResult::frame_limit: {
      const bool is_child = tree.names.find(stripped(request.names[row.child])) == 0;
      return frame_rejection(shown(request.names[is_child ? row.child : row.parent]),
                             tree.options.max_frames);
    }
    case RowResult::stray: {
      const FrameId child = tree.names.find(stripped(request.names[row.child]));
      const Stamp newest =
          child != 0 ? tree.frames[child].latest.stamp.load(std::memory_order_relaxed) : row.stamp;
      Rejected rejected =
          rejection(request, row, "stamp_ns",
                    "the stamp " + std::to_string(row.stamp) +
                        " ns is far ahead of the frame's newest, " + std::to_string(newest) +
                        " ns, and of another clock, unless more such samples follow");
      rejected.newest = newest;
      return rejected;
    }
    case RowResult::memory_limit:
      return memory_rejection(request, row, tree.options.max_memory_bytes);
    default:
      return row_rejection(request, row, result, tree.options);
  }
}

}  // namespace ztf
