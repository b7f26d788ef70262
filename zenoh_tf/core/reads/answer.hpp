// Parts of answers that need no reader: failures, and stamps.
//
// Thread safety: any thread. A failure is valid only after the guard has validated the paths that
// it was made from (reads/guards.hpp).
#pragma once

#include <algorithm>
#include <limits>
#include <utility>

#include "reads/query.hpp"
#include "reads/walk.hpp"

namespace ztf {

// The oldest and the newest of some links' stamps; static links have none.
class StampRange {
 public:
  void include(Stamp stamp) noexcept {
    if (stamp == kNoStamp) return;
    oldest_ = std::min(oldest_, stamp);
    newest_ = std::max(newest_, stamp);
  }
  // True if no stamp was included; then oldest() and newest() are unspecified.
  [[nodiscard]] bool empty() const noexcept { return newest_ == kNoStamp; }
  [[nodiscard]] Stamp oldest() const noexcept { return oldest_; }
  [[nodiscard]] Stamp newest() const noexcept { return newest_; }
  // True if all included stamps are equal, or none was included.
  [[nodiscard]] bool all_equal() const noexcept { return oldest_ >= newest_; }

 private:
  Stamp oldest_ = std::numeric_limits<Stamp>::max();
  Stamp newest_ = kNoStamp;
};

inline Code code_of(LinkLookup::Status status) noexcept {
  switch (status) {
    case LinkLookup::Status::no_data:
      return Code::no_data;
    case LinkLookup::Status::backward:
      return Code::backward;
    case LinkLookup::Status::forward:
      return Code::forward;
    default:
      return Code::extrapolation;
  }
}

// Returns the range of the newest links' stamps. Requires a chain of SelectLatest.
inline StampRange stamps_of(const Chain& chain) noexcept {
  StampRange stamps;
  for (const PathStep& step : chain.source) stamps.include(step.interval.time);
  for (const PathStep& step : chain.target) stamps.include(step.interval.time);
  return stamps;
}

// A link of a chain that is interpolated over more than a limit allows.
struct LongInterval {
  const PathStep* step = nullptr;  // null: there is none
  const Frame* parent = nullptr;
};

// Returns the longest one of the chain.
inline LongInterval find_long_interval(const Chain& chain, Stamp limit) noexcept {
  LongInterval found;
  Stamp longest = 0;
  for (const PathSegment& steps : {chain.target, chain.source})
    for (std::size_t i = 0; i < steps.size(); ++i) {
      const Stamp interval = interpolated_ns(steps[i].interval);
      if (interval <= longest || !exceeds(*steps[i].frame, interval, limit)) continue;
      longest = interval;
      found = {&steps[i], i + 1 < steps.size() ? steps[i + 1].frame : chain.common_ancestor};
    }
  return found;
}

// Sets the failure of a lookup of two frames, target and source, if a link is interpolated over
// more than the limit allows.
template <class Access>
[[gnu::noinline]] void check_gaps(const Access& access, const Chain& chain, Stamp limit,
                                  std::pair<FrameId, FrameId> frames,
                                  const std::atomic<std::uint64_t>& ids_freed, Answer& a) {
  const auto [step, parent] = find_long_interval(chain, limit);
  if (!step) return;
  const auto acquire = std::memory_order_acquire;
  a.failure = {.code = Code::gap,
               .target = frames.first,
               .source = frames.second,
               .frame = access.id_of(step->frame),
               .parent = access.id_of(parent),
               .stamp = a.stamp,
               .oldest = step->interval.older->stamp.load(acquire),
               .newest = step->interval.newer->stamp.load(acquire),
               .max_gap = limit,
               .ids_freed = ids_freed.load(acquire)};
}

// Returns 0 if all links are static, because any time serves then.
inline Stamp oldest_or_zero(const StampRange& stamps) noexcept {
  return stamps.empty() ? 0 : stamps.oldest();
}
inline void set_stamps(const StampRange& stamps, Answer& a) noexcept {
  a.stamp = oldest_or_zero(stamps);
  a.newest = stamps.empty() ? 0 : stamps.newest();
}

// Returns the parent that a frame without a sample at a time counts as having then: before its
// history the oldest sample's, else the newest's.
template <class Access>
FrameId parent_beyond(const Access& access, const Frame& frame,
                      LinkLookup::Status status) noexcept {
  return status == LinkLookup::Status::backward ? oldest_parent(frame, access.ring(frame))
                                                : frame.parent.load(std::memory_order_acquire);
}

// A link selector for the link at a time, also beyond the history.
struct SelectAround {
  static constexpr bool is_forest = false;
  Stamp time;
  template <class Access>
  LinkLookup operator()(const Access& access, const Frame& frame,
                        SampleInterval& interval) const noexcept {
    const LinkLookup link = SelectAt{time}(access, frame, interval);
    if (link.status == LinkLookup::Status::ok) return link;
    const FrameId parent = parent_beyond(access, frame, link.status);
    return {parent == 0 ? LinkLookup::Status::root : LinkLookup::Status::ok, parent};
  }
};

// Sets the link that has no sample at the failure's time, and why.
template <class Access>
void set_link(const Access& access, const Frame& frame, LinkLookup::Status status,
              Failure& failure) noexcept {
  failure.code = code_of(status);
  failure.frame = access.id_of(&frame);
  failure.parent = parent_beyond(access, frame, status);
  failure.oldest = oldest_served_stamp(frame);
  failure.newest = frame.latest.stamp.load(std::memory_order_acquire);
}

// Sets the reason why two complete paths have no common frame. If there are several, the order is
// tf2's: a path that is too deep, then a link without a sample, then unconnected trees.
template <class Access>
void report_failure(const Access& access, const AncestorPath& from_target,
                    const AncestorPath& from_source, Stamp stamp, Answer& a) noexcept {
  const auto id_of = [&](const Frame* frame) { return access.id_of(frame); };
  a = Answer{.failure = {.code = Code::connectivity,
                         .target = id_of(from_target.start),
                         .source = id_of(from_source.start)}};
  a.failure.stamp = stamp;
  a.failure.target_root = id_of(from_target.highest);
  a.failure.source_root = id_of(from_source.highest);
  for (const AncestorPath* path : {&from_source, &from_target})
    if (path->state == AncestorPath::State::too_deep) {
      a.failure.code = Code::lookup;
      a.failure.frame = id_of(path->highest);
      return;
    }
  for (const AncestorPath* path : {&from_target, &from_source})
    if (path->state == AncestorPath::State::no_sample)
      return set_link(access, *path->highest, path->failure, a.failure);
}

// If several links between the two frames have no sample at the failure's time, makes it name the
// one whose samples are farthest from that time, as tf2 does: mostly the one to wait for. Where the
// links of that time do not connect the frames, the failure stays as it is. Returns false if the
// guard demands a retry.
template <class Access, class Guard>
[[gnu::noinline, gnu::cold]] bool name_farthest_link(const Access& access, Guard& guard,
                                                     std::uint32_t max_depth, FrameId target,
                                                     FrameId source, Answer& a) {
  if (a.failure.oldest == kNoStamp) return true;  // no link lacks a sample
  AncestorPath from_source(access.frame(source)), from_target(access.frame(target));
  Chain chain;
  Walker<Access, Guard, SelectAround> walker(access, guard, {a.failure.stamp}, max_depth);
  const WalkResult result = walker.find_chain(from_source, from_target, chain);
  if (result != WalkResult::reached) return result != WalkResult::retry;
  std::uint64_t farthest = 0;
  for (const PathSegment steps : {chain.target, chain.source})
    for (const PathStep& step : steps) {
      const Frame& frame = *step.frame;
      SampleInterval unused;
      const auto status = find_link(frame, access.ring(frame), a.failure.stamp, unused).status;
      if (status == LinkLookup::Status::ok || status == LinkLookup::Status::root) continue;
      const Stamp oldest = oldest_served_stamp(frame);
      const Stamp newest = frame.latest.stamp.load(std::memory_order_acquire);
      const std::uint64_t distance = a.failure.stamp < oldest ? span_ns(a.failure.stamp, oldest)
                                                              : span_ns(newest, a.failure.stamp);
      if (distance <= farthest) continue;
      farthest = distance;
      set_link(access, frame, status, a.failure);
    }
  return guard.validate(chain.source) && guard.validate(chain.target);
}

}  // namespace ztf
