// The folder `lookups/`: the lookups of a tree of this process or of a shared one.
// In: queries. Out: answers, validated; a lookup that fails too often takes locks.
// It may include base, reads, estimates, tree_state.hpp, modes, shared.
//
// The lookups of a tree. Each is one transaction, unless it says otherwise.
//
// Thread safety: every function, from any thread.
#pragma once

#include <span>
#include <vector>

#include "estimates/estimate.hpp"
#include "reads/velocity.hpp"
#include "tree_state.hpp"

namespace ztf {

class EstimateCache;
class Motion;
class MotionLimitTable;

void lookup(const TreeState& tree, const Query& query, Answer& answer);
// Each query as a transaction of its own, or together with its neighbours. Queries of one pair of
// frames at many times then take a fraction of the time.
void lookup_batch(const TreeState& tree, std::span<const Query> queries, std::span<Answer> answers);
// All queries in one transaction, at one instant. Sets `reads` to the frames that the answers rest
// on, with their versions. Throws Rejected if more than `max_reads` frames are read, each counted
// for every query that reads it.
void lookup_transaction(const TreeState& tree, std::span<const Query> queries,
                        std::span<Answer> answers, ReadSet& reads,
                        std::size_t max_reads = kNoReadLimit);
void lookup_velocity(const TreeState& tree, const VelocityQuery& query, VelocityAnswer& answer);
// A pose at a time that may be beyond the newest samples, with bounds of its errors. Costs a few
// lookups, or some hundred microseconds if the backtests of the question have to be made; `cache`
// keeps those of this tree. Throws bad_alloc.
void estimate(const TreeState& tree, EstimateCache& cache, const MotionLimitTable& limits,
              const EstimateQuery& query, EstimateAnswer& answer);
// Copies the motion of one frame in another. If the lookup at one of the query's times fails,
// `answer` has the failure, and the rest is unspecified. Throws bad_alloc.
MotionResult lookup_motion(const TreeState& tree, const MotionQuery& query, Motion& motion,
                           Answer& answer);
// Sets `frames` to those from target to source over their common ancestor.
Failure chain(const TreeState& tree, const Query& query, std::vector<FrameId>& frames);
// Returns the frames from each start up to its root, each once. A frame's parent is that of its
// link at a time, if it has one, else of its newest.
[[nodiscard]] std::vector<NamedInfo> ancestors(const TreeState& tree,
                                               std::span<const FrameId> starts, Stamp stamp);
// True if a later commit could make a lookup succeed that failed so.
[[nodiscard]] bool may_succeed_later(const TreeState& tree, const Failure& failure) noexcept;

}  // namespace ztf
