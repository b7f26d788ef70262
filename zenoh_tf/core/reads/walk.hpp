// Walking from two frames up to their lowest common ancestor.
//
// A walk first tries the source's path alone, for up to 16 links, because the target is often a
// near ancestor. Then it extends both paths in turns, so near frames cost little in a high tree.
// If it finds a chain, the reader validates only the chain's links, so a change above the common
// ancestor cannot disturb the lookup. There is one exception: once any frame was reparented, a
// lookup at a time validates both paths as a whole (Reader::with_chain).
//
// Thread safety: paths and chains belong to one thread. What a walk finds, a failure included, is
// meaningful only after its guard has validated the steps (reads/guards.hpp).
#pragma once

#include "reads/guards.hpp"
#include "reads/query.hpp"
#include "records/frame_access.hpp"

namespace ztf {

// The link of a frame's newest sample, loaded from its record.
struct LatestLink {
  ZTF_ALWAYS_INLINE explicit LatestLink(const Frame& frame) noexcept
      : parent(frame.parent.load(std::memory_order_acquire)),
        stamp(frame.is_static.load(std::memory_order_acquire)
                  ? kNoStamp
                  : frame.latest.stamp.load(std::memory_order_acquire)) {}
  FrameId parent;  // 0 for a root
  Stamp stamp;     // kNoStamp for a static link
};

// A link selector decides which of a frame's links a walk follows. This one selects the newest.
struct SelectLatest {
  static constexpr bool is_forest = true;  // newest links never form a loop (tree_state.hpp)
  template <class Access>
  ZTF_ALWAYS_INLINE LinkLookup operator()(const Access&, const Frame& frame,
                                          SampleInterval& interval) const noexcept {
    const LatestLink link(frame);
    interval = {&frame.latest, &frame.latest, link.stamp};
    return {link.parent == 0 ? LinkLookup::Status::root : LinkLookup::Status::ok, link.parent};
  }
};

// A link selector for the link at a given time. Past links may form a loop; the depth limit ends a
// walk in it.
struct SelectAt {
  static constexpr bool is_forest = false;
  Stamp time;
  template <class Access>
  ZTF_ALWAYS_INLINE LinkLookup operator()(const Access& access, const Frame& frame,
                                          SampleInterval& interval) const noexcept {
    return find_link(frame, access.ring(frame), time, interval);
  }
};

// A frame's ancestors, as far as they were walked.
struct AncestorPath {
  enum class State : std::uint8_t {
    open,       // can be extended
    root,       // `highest` has no parent
    no_sample,  // `highest` has no sample at the time; `failure` says why
    too_deep,   // `highest` has a parent, but the path is as long as the depth limit allows
  };

  ZTF_ALWAYS_INLINE explicit AncestorPath(const Frame* from) noexcept
      : start(from), highest(from) {}

  // Returns the number of links from the start to a frame, or -1 if it is not on the path.
  [[nodiscard]] std::ptrdiff_t find(const Frame* frame) const noexcept {
    for (std::size_t i = 0; i < steps.size(); ++i)
      if (steps[i].frame == frame) return static_cast<std::ptrdiff_t>(i);
    return highest == frame ? static_cast<std::ptrdiff_t>(steps.size()) : -1;
  }
  // Returns the frame that many links above the start.
  [[nodiscard]] const Frame* frame_above(std::size_t links) const noexcept {
    return links < steps.size() ? steps[links].frame : highest;
  }

  const Frame* const start;
  const Frame* highest;  // the frame that the path has reached
  State state = State::open;
  LinkLookup::Status failure = LinkLookup::Status::ok;
  Version highest_version;          // set once the path is not open
  SmallVector<PathStep, 32> steps;  // steps[i].frame is start, its parent, ...
};

// The first steps of an ancestor path, from its start up to the common ancestor.
using PathSegment = std::span<PathStep>;

// The links between two frames: from each of them up to their common ancestor.
struct Chain {
  PathSegment source, target;
  const Frame* common_ancestor;
};

// The number of links that a walk first extends the source's path by. compose_newest_links() has
// the same limit (reads/fast_path.hpp).
constexpr std::size_t kDirectLinks = 16;

enum class WalkResult : std::uint8_t {
  reached,    // the walk has found what it was looking for
  exhausted,  // it has not, because it came to a limit or the end of a path
  retry,      // the guard demands fresh state
};

// Extends ancestor paths under a guard.
template <class Access, class Guard, class LinkSelector>
class Walker {
 public:
  ZTF_ALWAYS_INLINE Walker(const Access& access, Guard& guard, LinkSelector select,
                           std::size_t max_depth) noexcept
      : access_(access), guard_(guard), select_(select), max_depth_(max_depth) {}

  // Finds the chain between the starts of two new paths. If the result is exhausted, there is none
  // and neither path is open.
  ZTF_ALWAYS_INLINE WalkResult find_chain(AncestorPath& from_source, AncestorPath& from_target,
                                          Chain& chain) {
    // Common case: the target is a near ancestor of the source.
    const WalkResult direct = extend(from_source, kDirectLinks, from_target.start);
    if (direct == WalkResult::exhausted)
      return find_common_ancestor(from_source, from_target, chain);
    chain = {{from_source.steps.begin(), from_source.steps.size()}, {}, from_source.highest};
    return direct;
  }

 private:
  // By how many links both paths are extended in turns. Each new frame is looked for in the whole
  // other path, which is quadratic and pays only for short paths.
  static constexpr int kNearLinks = 48;
  // By how many links at a time a path is then extended to its end. Sorting finds the ancestor.
  static constexpr std::size_t kFarLinks = 64;

  // Extends a path by up to that many links. Returns `reached` at the frame `goal`, `retry` if the
  // guard demands it, else `exhausted`.
  ZTF_ALWAYS_INLINE WalkResult extend(AncestorPath& path, std::size_t links, const Frame* goal) {
    using State = AncestorPath::State;
    if (path.state != State::open) return WalkResult::exhausted;
    PathStep* step = path.steps.reserve(links) + path.steps.size();
    const Frame* frame = path.highest;  // in a register: every load of the next step depends on it
    WalkResult result = WalkResult::exhausted;
    for (; links > 0; --links, ++step) {
      step->frame = frame;
      if (!guard_.read_version(*frame, step->version)) return WalkResult::retry;
      const LinkLookup link = select_(access_, *frame, step->interval);
      // A torn read may give parent 0 with status ok. Validation will find that out.
      const bool has_link = link.status == LinkLookup::Status::ok && link.parent != 0;
      if (!has_link || path.steps.size() == max_depth_) [[unlikely]] {
        path.failure = link.status;
        path.highest_version = step->version;
        // A past sample has parent 0 if its parent's id was freed (commits/freed_names.cpp).
        const bool is_root =
            link.status == LinkLookup::Status::root || link.status == LinkLookup::Status::ok;
        path.state = has_link ? State::too_deep : is_root ? State::root : State::no_sample;
        break;
      }
      path.steps.set_size(path.steps.size() + 1);
      frame = access_.frame(link.parent);
      if (frame == goal) {
        result = WalkResult::reached;
        break;
      }
    }
    path.highest = frame;
    return result;
  }

  // Extends both paths until they have a common frame.
  [[gnu::noinline]] WalkResult find_common_ancestor(AncestorPath& from_source,
                                                    AncestorPath& from_target, Chain& chain) {
    for (int i = 0; i < kNearLinks; ++i)
      for (AncestorPath* path : {&from_target, &from_source}) {
        if (path->state != AncestorPath::State::open) continue;
        if (extend(*path, 1, nullptr) == WalkResult::retry) return WalkResult::retry;
        const bool is_source = path == &from_source;
        const std::ptrdiff_t other = (is_source ? from_target : from_source).find(path->highest);
        if (other < 0) continue;
        const auto links = path->steps.size(), other_links = static_cast<std::size_t>(other);
        chain = make_chain(from_source, is_source ? links : other_links, from_target,
                           is_source ? other_links : links);
        return WalkResult::reached;
      }
    for (AncestorPath* path : {&from_target, &from_source})
      while (path->state == AncestorPath::State::open)
        if (extend(*path, kFarLinks, nullptr) == WalkResult::retry) return WalkResult::retry;
    return find_far_ancestor(from_source, from_target, chain);
  }

  // Finds the lowest common frame of two long, complete paths, by sorting one of them.
  static WalkResult find_far_ancestor(AncestorPath& from_source, AncestorPath& from_target,
                                      Chain& chain) {
    struct Ancestor {
      const Frame* frame;
      std::size_t links;
      // A path that is too deep may visit a frame several times. Its first visit is the lowest.
      bool operator<(const Ancestor& other) const noexcept {
        return frame != other.frame ? frame < other.frame : links < other.links;
      }
    };
    SmallVector<Ancestor, 32> ancestors;
    for (std::size_t i = 0; i <= from_source.steps.size(); ++i)
      ancestors.push_back({from_source.frame_above(i), i});
    std::sort(ancestors.begin(), ancestors.end());
    for (std::size_t i = 0; i <= from_target.steps.size(); ++i) {
      const Frame* const frame = from_target.frame_above(i);
      const auto at = std::lower_bound(ancestors.begin(), ancestors.end(), Ancestor{frame, 0});
      if (at == ancestors.end() || at->frame != frame) continue;
      chain = make_chain(from_source, at->links, from_target, i);
      return WalkResult::reached;
    }
    return WalkResult::exhausted;
  }

  static Chain make_chain(AncestorPath& from_source, std::size_t source_links,
                          AncestorPath& from_target, std::size_t target_links) noexcept {
    return {{from_source.steps.begin(), source_links},
            {from_target.steps.begin(), target_links},
            from_target.frame_above(target_links)};
  }

  const Access& access_;
  Guard& guard_;
  const LinkSelector select_;
  const std::size_t max_depth_;
};

}  // namespace ztf
