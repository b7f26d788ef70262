// From two frames up to where their ways meet.
//
// Both ways grow by turns, so that for near frames the cost follows their
// distance, not the height of the tree, and so that nothing far above the
// meeting point is read, or can disturb.
//
// Thread safety: values on the reader's stack. What a walk returns, failures
// included, is good only once its guard says so (guards.hpp).
#pragma once

#include "compose.hpp"
#include "guards.hpp"
#include "query.hpp"

namespace ztf {

// A frame's newest link.
struct LatestLink {
  ZTF_ALWAYS_INLINE explicit LatestLink(const Frame& frame) noexcept
      : parent(frame.parent.load(std::memory_order_acquire)),
        stamp(frame.is_static.load(std::memory_order_acquire)
                  ? kNoStamp
                  : frame.latest.stamp.load(std::memory_order_acquire)) {}
  FrameId parent;
  Stamp stamp;  // kNoStamp where static, good for all times
};

// How a way goes up from a frame: by its newest link,
struct SelectLatest {
  static constexpr bool is_forest = true;
  ZTF_ALWAYS_INLINE LinkLookup operator()(const Frame& frame,
                                          SampleInterval& interval) const noexcept {
    const LatestLink newest(frame);
    return newest_link(frame,
                       newest.parent == 0 ? LinkLookup::Status::root : LinkLookup::Status::ok,
                       newest.parent, newest.stamp, interval);
  }
};

// or by that of a time.
struct SelectAt {
  static constexpr bool is_forest = false;  // in the past there can be loops
  Stamp at;
  ZTF_ALWAYS_INLINE LinkLookup operator()(const Frame& frame,
                                          SampleInterval& interval) const noexcept {
    return find_link(frame, at, interval);
  }
};

// One way up, from its start to the frame that it has reached.
struct AncestorPath {
  enum class End : std::uint8_t { open, root, no_sample, too_deep };

  ZTF_ALWAYS_INLINE explicit AncestorPath(const Frame* from) noexcept : start(from), top(from) {}

  const Frame* const start;
  const Frame* top;
  End end = End::open;
  LinkLookup::Status failure = LinkLookup::Status::ok;  // where broken: at the top, for this reason
  Version top_version;                                  // where it has ended
  SmallVector<PathStep, 32> steps;                      // steps[i].frame: start, its parent, ...

  // The number of links up to a frame, or -1.
  [[nodiscard]] std::ptrdiff_t find(const Frame* frame) const noexcept {
    for (std::size_t i = 0; i < steps.size(); ++i)
      if (steps[i].frame == frame) return static_cast<std::ptrdiff_t>(i);
    return top == frame ? static_cast<std::ptrdiff_t>(steps.size()) : -1;
  }
  // The frame above that many links.
  [[nodiscard]] const Frame* frame_above(std::size_t links) const noexcept {
    return links < steps.size() ? steps[links].frame : top;
  }
};

// The links on one side of the frame where two ways meet.
struct PathSegment {
  PathStep* steps;
  std::size_t links;

  [[nodiscard]] const Frame* frame_above(std::size_t i,
                                         const Frame* common_ancestor) const noexcept {
    return i < links ? steps[i].frame : common_ancestor;
  }
};

// The links between two frames.
struct Chain {
  PathSegment source, target;
  const Frame* common_ancestor;
};

// Oldest and newest of some links' stamps; static ones are of all times and do
// not count.
class StampRange {
 public:
  StampRange() noexcept = default;
  ZTF_ALWAYS_INLINE explicit StampRange(const Chain& chain) noexcept {
    include(chain.source);
    include(chain.target);
  }
  void include(Stamp stamp) noexcept {
    oldest_ = std::min(oldest_, rank(stamp));
    newest_ = std::max(newest_, stamp);
  }
  ZTF_ALWAYS_INLINE void include(const PathSegment& side) noexcept {
    if (side.links == 0) return;
    // Links that are written together have one stamp: no search for the extremes.
    const Stamp first = side.steps[0].interval.time;
    std::uint64_t differing = 0;
    for (std::size_t i = 1; i < side.links; ++i)
      differing |= static_cast<std::uint64_t>(side.steps[i].interval.time ^ first);
    include(first);
    for (std::size_t i = 1; differing != 0 && i < side.links; ++i)
      include(side.steps[i].interval.time);
  }
  // kNoStamp where all links are static.
  [[nodiscard]] Stamp oldest() const noexcept {
    return static_cast<Stamp>(oldest_ + 1 + static_cast<std::uint64_t>(kNoStamp));
  }
  [[nodiscard]] Stamp newest() const noexcept { return newest_; }

 private:
  // In the order of stamps, but for kNoStamp, the smallest, which comes last.
  static std::uint64_t rank(Stamp stamp) noexcept {
    return static_cast<std::uint64_t>(stamp) - static_cast<std::uint64_t>(kNoStamp) - 1;
  }
  std::uint64_t oldest_ = rank(kNoStamp);
  Stamp newest_ = kNoStamp;
};

enum class WalkResult : std::uint8_t { reached, exhausted, retry };

// Finds ways under a guard.
template <class Guard, class LinkSelector>
class Walker {
 public:
  ZTF_ALWAYS_INLINE Walker(const Frame* frames, Guard& guard, LinkSelector select,
                           std::size_t max_depth) noexcept
      : frames_(frames), guard_(guard), select_(select), max_depth_(max_depth) {}

  // Up to `turn` links; `arrived` where that reaches `goal`.
  ZTF_ALWAYS_INLINE WalkResult extend(AncestorPath& path, std::size_t turn, const Frame* goal) {
    if (path.end != AncestorPath::End::open) [[unlikely]]
      return WalkResult::exhausted;
    // Locals, so that the loop keeps its state in registers.
    const std::size_t n = path.steps.size();
    PathStep* const steps = path.steps.reserve(turn) + n;
    const PathStep* const until = steps + turn;
    const PathStep* const deepest = steps + (max_depth_ - n);
    PathStep* step = steps;
    const Frame* frame = path.top;
    WalkResult result = WalkResult::exhausted;
    while (step != until) {
      Version version;
      if (!guard_.read_version(*frame, version)) [[unlikely]]
        return WalkResult::retry;
      const LinkLookup link = select_(*frame, step->interval);
      if (link.status != LinkLookup::Status::ok || link.parent == 0) [[unlikely]] {
        path.failure = link.status;
        path.top_version = version;
        path.end = link.status == LinkLookup::Status::root ? AncestorPath::End::root
                                                           : AncestorPath::End::no_sample;
        break;
      }
      if (step == deepest) [[unlikely]] {
        path.top_version = version;
        path.end = AncestorPath::End::too_deep;
        break;
      }
      step->frame = frame;
      step->version = version;
      ++step;
      frame = frames_ + link.parent;
      if (frame == goal) {
        result = WalkResult::reached;
        break;
      }
    }
    path.top = frame;
    path.steps.set_size(n + static_cast<std::size_t>(step - steps));
    return result;
  }

  // Both ways by turns, until they meet. `no`: they do not.
  WalkResult find_common_ancestor(AncestorPath& from_source, AncestorPath& from_target,
                                  Chain& chain) {
    const auto make_chain = [&](const AncestorPath& path, std::size_t links,
                                std::size_t other_links) {
      const bool source = &path == &from_source;
      chain = {{from_source.steps.begin(), source ? links : other_links},
               {from_target.steps.begin(), source ? other_links : links},
               path.frame_above(links)};
      return WalkResult::reached;
    };
    for (int i = 0; i < kNear; ++i)
      for (AncestorPath* path : {&from_target, &from_source}) {
        if (path->end != AncestorPath::End::open) continue;
        if (extend(*path, 1, nullptr) == WalkResult::retry) return WalkResult::retry;
        const std::ptrdiff_t at =
            (path == &from_source ? from_target : from_source).find(path->top);
        if (at >= 0) return make_chain(*path, path->steps.size(), static_cast<std::size_t>(at));
      }
    for (AncestorPath* path : {&from_target, &from_source})
      while (path->end == AncestorPath::End::open)
        if (extend(*path, 64, nullptr) == WalkResult::retry) return WalkResult::retry;

    // Far apart, if at all: the first frame of one that is among the other's, sorted.
    struct Visit {
      const Frame* frame;
      std::uint32_t links;
      bool operator<(const Visit& other) const noexcept { return frame < other.frame; }
    };
    SmallVector<Visit, 32> visits;
    for (std::uint32_t i = 0; i <= from_source.steps.size(); ++i)
      visits.push_back({from_source.frame_above(i), i});
    std::sort(visits.begin(), visits.end());
    for (std::size_t i = 0; i <= from_target.steps.size(); ++i) {
      const Frame* const frame = from_target.frame_above(i);
      const Visit* const at = std::lower_bound(visits.begin(), visits.end(), Visit{frame, 0});
      if (at != visits.end() && at->frame == frame) return make_chain(from_target, i, at->links);
    }
    return WalkResult::exhausted;
  }

 private:
  static constexpr int kNear = 48;

  const Frame* const frames_;
  Guard& guard_;
  const LinkSelector select_;
  const std::size_t max_depth_;
};

}  // namespace ztf
