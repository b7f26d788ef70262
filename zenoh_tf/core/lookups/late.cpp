// Which link a failed lookup lacks a sample of.
#include "lookups/late.hpp"

#include "lookups/lookup.hpp"

namespace ztf {

LateLink find_late_link(const TreeState& tree, const Failure& failure) {
  // Other failures have no newest sample, or one that is not older than the time asked for.
  if (failure.newest == kNoStamp || failure.stamp <= failure.newest) return {};
  std::vector<FrameId> frames;
  const Query newest_links{.op = Op::at, .target = failure.target, .source = failure.source};
  if (chain(tree, newest_links, frames).code != Code::ok) return {};
  LateLink late{.asked = failure.stamp, .newest = failure.stamp, .ids_freed = failure.ids_freed};
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const LatestLink link(tree.frames[frames[i]]);
    const bool is_below = (i > 0 && link.parent == frames[i - 1]) ||
                          (i + 1 < frames.size() && link.parent == frames[i + 1]);
    if (!is_below || link.stamp == kNoStamp || link.stamp >= late.newest) continue;
    late.frame = frames[i];
    late.newest = link.stamp;
  }
  return late;
}

void count_late(const TreeState& tree, const LateLink& link, std::int64_t asked_at_ns,
                Late late) noexcept {
  if (link.frame == 0) return;
  // Unsigned, as the stamps may be further apart than a signed number can say.
  const std::uint64_t late_ns =
      static_cast<std::uint64_t>(link.asked) - static_cast<std::uint64_t>(link.newest);
  if (late_ns > kMostLateNs || link.asked > asked_at_ns + kMostAheadNs) return;
  if (link.ids_freed != tree.ids_freed.load(std::memory_order_acquire)) return;
  FrameEvents& events = tree.events[link.frame];
  auto& lookups = late == Late::failed ? events.late_failures : events.late_waits;
  lookups.fetch_add(1, std::memory_order_relaxed);
  events.late_ns.fetch_add(late_ns, std::memory_order_relaxed);
}

}  // namespace ztf
