// Sums over a tree, and its events by name.
#include "tree.hpp"

namespace ztf {

TreeTotals Tree::sum_totals() const noexcept {
  const auto acquire = std::memory_order_acquire;
  TreeTotals sum;
  sum.rewritten = totals_of_removed.rewritten.load(acquire);
  sum.dropped = totals_of_removed.dropped.load(acquire);
  sum.evicted = totals_of_removed.evicted.load(acquire);
  for (FrameId id = 1, n = size(); id <= n; ++id) {
    const FrameInfo frame = info(id);
    const FrameEvents& counted = events(id);
    if (!removed(id)) ++sum.frames;
    if (frame.parent != 0 && frame.is_static)
      ++sum.static_links;
    else if (frame.parent != 0)
      sum.samples += frame.samples;
    sum.rewritten += counted.rewritten.load(acquire);
    sum.dropped += counted.dropped.load(acquire);
    sum.evicted += frame.evicted;
  }
  return sum;
}

// Counts that pass from a frame to totals_of_removed meanwhile might be summed twice, or not at
// all. A sum that has seen any of that sees `moves` change, too: it is odd before the first count
// is moved, and every load here has acquire order.
TreeTotals Tree::totals() const {
  constexpr int kAttempts = 3;
  const std::atomic<std::uint64_t>& moves = totals_of_removed.moves;
  for (int i = 0; i < kAttempts; ++i) {
    const std::uint64_t before = moves.load(std::memory_order_seq_cst);
    const TreeTotals sum = sum_totals();
    if (before % 2 == 0 && moves.load(std::memory_order_seq_cst) == before) return sum;
  }
  const auto lock = lock_announced(topology);  // no name loses its id
  return sum_totals();
}

std::pair<std::vector<Tree::NamedEvent>, std::uint64_t> Tree::take_events() {
  std::vector<NamedEvent> named;
  const auto lock = lock_announced(topology);  // no id passes to another name meanwhile
  const auto [events, lost] = event_log.take();
  const auto name_of = [&](FrameId id) { return id != 0 ? name(id) : std::string(); };
  for (const TreeEvent& event : events)
    named.push_back({event, name_of(event.frame), name_of(info(event.frame).parent),
                     name_of(event.parent_before)});
  return {std::move(named), lost};
}

}  // namespace ztf
