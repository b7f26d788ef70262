// Estimates: reading the path, and its history if the backtests of the question are not kept.
#include "base/long_wait.hpp"
#include "estimates/cache.hpp"
#include "estimates/conclude.hpp"
#include "estimates/limits.hpp"
#include "lookups/transaction.hpp"
#include "shared/transaction.hpp"
#include "system/host.hpp"

namespace ztf {

namespace {

// How often a path may change between the two transactions of an estimate.
constexpr int kAttempts = 8;

constexpr double kMostClockError = 1e6;  // seconds: any history is shorter

// Returns the limits of each link, or none at all if the table is empty, and sets the errors of the
// links' clocks.
template <class AnyTree>
std::vector<MotionLimits> limits_of(const AnyTree& tree, const MotionLimitTable& table,
                                    PathNow& path) {
  std::vector<MotionLimits> limits;
  if (table.empty()) return limits;
  for (LinkNow& link : path.links) {
    limits.push_back(table.find(tree.name(link.child)));
    link.clock_error =
        static_cast<Stamp>(1e9 * std::min(limits.back().clock_error, kMostClockError));
  }
  return limits;
}

// `read` runs a transaction, `edits` returns a number that changes with the histories of a path
// otherwise than by newer samples, or with the limits, and `find_limits` returns those of each
// link, or none.
template <class Read, class Edits, class Limits>
void estimate_by(const EstimateQuery& q, EstimateAnswer& a, EstimateCache& cache, Read&& read,
                 Edits&& edits, Limits&& find_limits) {
  PathNow path;
  Answer found;
  EstimateCache::Entry backtest;
  std::vector<MotionLimits> limits;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    read([&](auto& reader) { return read_path(reader, q, path, found); });
    a.failure = found.failure;
    if (a.failure.code != Code::ok) return;
    find_lags(q, path);
    if (is_too_far(q, path, a.failure)) return;
    const std::uint64_t state = edits(path);  // before the limits, so that it is not newer
    limits = find_limits(path);
    if (!may_err(path)) break;
    EstimateCache::Key key;
    EstimateCache::make_key(path, q.level, key);
    const Stamp grid = grid_of(path);
    bool is_current = false;
    backtest = cache.find(key, grid, state, is_current);
    if (is_current) break;
    LongWait::announce();
    Cases cases;
    const double window = window_s(window_class(q.level));
    read([&](auto& reader) { return copy_cases(reader, path, window, cases); });
    if (cases.moved && attempt + 1 < kAttempts) continue;
    backtest = std::make_shared<const Backtest>(ztf::backtest(path, cases, backtest.get()));
    cache.insert(key, grid, state, backtest);
    break;
  }
  conclude(q, path, backtest.get(), limits, a);
}

}  // namespace

void estimate(const TreeState& tree, EstimateCache& cache, const MotionLimitTable& limits,
              const EstimateQuery& query, EstimateAnswer& answer) {
  ReadSet reads;
  estimate_by(
      query, answer, cache, [&](auto&& body) { read(tree, reads, body); },
      [&](const PathNow& path) {
        std::uint64_t edits = limits.version();
        for (const LinkNow& link : path.links)
          edits += tree.edits[link.child].load(std::memory_order_acquire);
        return edits;
      },
      [&](PathNow& path) { return limits_of(tree, limits, path); });
}

void SharedTree::estimate(const EstimateQuery& query, EstimateAnswer& answer) const {
  ReadSet reads;
  estimate_by(
      query, answer, estimate_cache_, [&](auto&& body) { read(reads, body); },
      // The region has no count of all edits. So backtests serve for a step of the grid at most.
      [&](const PathNow& path) {
        std::uint64_t edits = static_cast<std::uint64_t>(monotonic_ns() / kGrid) << 32;
        edits += motion_limits_.version();
        for (const LinkNow& link : path.links) {
          const FrameEvents& events = events_[link.child];
          for (const auto* count : {&events.rewritten, &events.time_jumps, &events.reparented})
            edits += count->load(std::memory_order_acquire);
        }
        return edits;
      },
      [&](PathNow& path) { return limits_of(*this, motion_limits_, path); });
}

}  // namespace ztf
