// How a tree's state begins, and its lease.
#include "tree_state.hpp"

#include "base/host.hpp"

namespace ztf {

TreeState::TreeState(const Options& given)
    : options(given),
      region(options),
      frames(region.frames()),
      ring_arena(region, options.max_memory_bytes),
      events(region.events()),
      edits(options.max_ids() + 1),
      topology_index(options.max_ids() + 1),
      authority_counters(options.max_authorities),
      ever_reparented(region.header().ever_reparented),
      ids_freed(region.header().ids_freed),
      names(region.header().names, region.names(), options.max_ids(), region),
      authorities(region.header().authorities, region.authorities(), options.max_authorities,
                  region),
      change_log(options.max_log_bytes != 0 ? std::make_unique<ChangeLog>(options.max_log_bytes)
                                            : nullptr),
      wait_list(options, frames, events) {}

// The clock is read before the store: a thread that is stopped in between promises too little.
void TreeState::begin_lease(std::int64_t duration_ns) noexcept {
  const std::int64_t until = duration_ns > 0 ? monotonic_ns() + duration_ns : 0;
  region.header().lease_ns.store(until, std::memory_order_seq_cst);
}

}  // namespace ztf
