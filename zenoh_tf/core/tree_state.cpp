// How a tree's state begins, its lease, and what removed frames leave.
#include "tree_state.hpp"

#include "system/host.hpp"

namespace ztf {

TreeState::TreeState(const Options& given)
    : options(given),
      region(options),
      frames(region.frames()),
      ring_arena(region, options.max_memory_bytes),
      events(region.events()),
      edits(options.max_ids() + 1),
      authority_counters(options.max_authorities),
      ever_reparented(region.header().ever_reparented),
      ids_freed(region.header().ids_freed),
      names(region.header().names, region.names(), options.max_ids(), region),
      authorities(region.header().authorities, region.authorities(), options.max_authorities,
                  region),
      change_log(options.max_log_bytes != 0 ? std::make_unique<ChangeLog>(options.max_log_bytes)
                                            : nullptr),
      wait_list(options, frames, events) {}

void TreeState::forget_events(std::span<const FrameId> removed) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  totals_of_removed.moves.fetch_add(1, std::memory_order_seq_cst);
  for (const FrameId id : removed) {
    totals_of_removed.rewritten += events[id].rewritten.load(relaxed);
    totals_of_removed.dropped += events[id].dropped.load(relaxed);
    totals_of_removed.evicted += frames[id].evicted.load(relaxed);
    frames[id].evicted.store(0, std::memory_order_release);
    events[id].reset();
  }
  totals_of_removed.moves.fetch_add(1, std::memory_order_seq_cst);
}

// The clock is read before the store: a thread that is stopped in between promises too little.
void TreeState::begin_lease(std::int64_t duration_ns) noexcept {
  const std::int64_t until = duration_ns > 0 ? monotonic_ns() + duration_ns : 0;
  region.header().lease_ns.store(until, std::memory_order_seq_cst);
}

void TreeState::begin_startup(Startup startup) noexcept {
  const std::int64_t now = coarse_monotonic_ns();
  region.header().started_ns.store(now - startup.elapsed_ns, std::memory_order_relaxed);
  region.header().starting_until_ns.store(now + startup.left_ns, std::memory_order_release);
}

Startup TreeState::startup() const noexcept { return startup_of(region.header()); }

}  // namespace ztf
