// From two frames up to where their ways meet.
//
// Both ways grow by turns, so that for near frames the cost follows their
// distance, not the height of the tree, and so that nothing far above the
// meeting point is read, or can disturb.
//
// Thread safety: values on the reader's stack. What a walk returns, failures
// included, is good only once its guard says so (guards.hpp).
#pragma once

#include "answer.hpp"
#include "compose.hpp"
#include "guards.hpp"

namespace ztf {

// A frame's newest link.
struct Newest {
  ZTF_HOT explicit Newest(const Frame& frame) noexcept
      : parent(frame.parent.load(std::memory_order_acquire)),
        stamp(frame.is_static.load(std::memory_order_acquire)
                  ? kNoStamp
                  : frame.latest.stamp.load(std::memory_order_acquire)) {}
  FrameId parent;
  Stamp stamp;  // kNoStamp where static, good for all times
};

// How a way goes up from a frame: by its newest link,
struct NewestLink {
  static constexpr bool is_forest = true;
  ZTF_HOT Place operator()(const Frame& frame, Bracket& bracket) const noexcept {
    const Newest newest(frame);
    return at_newest(frame, newest.parent == 0 ? Place::Kind::root : Place::Kind::ok,
                     newest.parent, newest.stamp, bracket);
  }
};

// or by that of a time.
struct LinkAt {
  static constexpr bool is_forest = false;  // in the past there can be loops
  Stamp at;
  ZTF_HOT Place operator()(const Frame& frame, Bracket& bracket) const noexcept {
    return place_at(frame, at, bracket);
  }
};

// One way up, from its start to the frame that it has reached.
struct Way {
  enum class End : std::uint8_t { open, root, broken, too_deep };

  ZTF_HOT explicit Way(const Frame* from) noexcept : start(from), top(from) {}

  const Frame* const start;
  const Frame* top;
  End end = End::open;
  Place::Kind why = Place::Kind::ok;  // where broken: at the top, for this reason
  Version top_version;                // where it has ended
  SmallVector<Step, 32> steps;        // steps[i].frame: start, its parent, ...

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
struct Side {
  Step* steps;
  std::size_t links;

  [[nodiscard]] const Frame* frame_above(std::size_t i, const Frame* meeting) const noexcept {
    return i < links ? steps[i].frame : meeting;
  }
};

// The links between two frames.
struct Chain {
  Side source, target;
  const Frame* meeting;
};

// Oldest and newest of some links' stamps; static ones are of all times and do
// not count.
class StampRange {
 public:
  StampRange() noexcept = default;
  ZTF_HOT explicit StampRange(const Chain& chain) noexcept {
    include(chain.source);
    include(chain.target);
  }
  void include(Stamp stamp) noexcept {
    oldest_ = std::min(oldest_, rank(stamp));
    newest_ = std::max(newest_, stamp);
  }
  ZTF_HOT void include(const Side& side) noexcept {
    if (side.links == 0) return;
    // Links that are written together have one stamp: no search for the extremes.
    const Stamp first = side.steps[0].bracket.time;
    std::uint64_t differing = 0;
    for (std::size_t i = 1; i < side.links; ++i)
      differing |= static_cast<std::uint64_t>(side.steps[i].bracket.time ^ first);
    include(first);
    for (std::size_t i = 1; differing != 0 && i < side.links; ++i) include(side.steps[i].bracket.time);
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

enum class Climbed : std::uint8_t { arrived, no, restart };

// Finds ways under a guard.
template <class Guard, class LinkOf>
class Walker {
 public:
  ZTF_HOT Walker(const Frame* frames, Guard& guard, LinkOf link_of, std::size_t max_depth) noexcept
      : frames_(frames), guard_(guard), link_of_(link_of), max_depth_(max_depth) {}

  // Up to `turn` links; `arrived` where that reaches `goal`.
  ZTF_HOT Climbed climb(Way& way, std::size_t turn, const Frame* goal) {
    if (way.end != Way::End::open) [[unlikely]]
      return Climbed::no;
    // Locals, so that the loop keeps its state in registers.
    const std::size_t n = way.steps.size();
    Step* const steps = way.steps.reserve(turn) + n;
    const Step* const until = steps + turn;
    const Step* const deepest = steps + (max_depth_ - n);
    Step* step = steps;
    const Frame* frame = way.top;
    Climbed climbed = Climbed::no;
    while (step != until) {
      Version version;
      if (!guard_.enter(*frame, version)) [[unlikely]]
        return Climbed::restart;
      const Place link = link_of_(*frame, step->bracket);
      if (link.kind != Place::Kind::ok || link.parent == 0) [[unlikely]] {
        way.why = link.kind;
        way.top_version = version;
        way.end = link.kind == Place::Kind::root ? Way::End::root : Way::End::broken;
        break;
      }
      if (step == deepest) [[unlikely]] {
        way.top_version = version;
        way.end = Way::End::too_deep;
        break;
      }
      step->frame = frame;
      step->version = version;
      ++step;
      frame = frames_ + link.parent;
      if (frame == goal) {
        climbed = Climbed::arrived;
        break;
      }
    }
    way.top = frame;
    way.steps.set_size(n + static_cast<std::size_t>(step - steps));
    return climbed;
  }

  // Both ways by turns, until they meet. `no`: they do not.
  Climbed meet(Way& from_source, Way& from_target, Chain& chain) {
    const auto met = [&](const Way& way, std::size_t links, std::size_t other_links) {
      const bool source = &way == &from_source;
      chain = {{from_source.steps.begin(), source ? links : other_links},
               {from_target.steps.begin(), source ? other_links : links},
               way.frame_above(links)};
      return Climbed::arrived;
    };
    for (int i = 0; i < kNear; ++i)
      for (Way* way : {&from_target, &from_source}) {
        if (way->end != Way::End::open) continue;
        if (climb(*way, 1, nullptr) == Climbed::restart) return Climbed::restart;
        const std::ptrdiff_t at = (way == &from_source ? from_target : from_source).find(way->top);
        if (at >= 0) return met(*way, way->steps.size(), static_cast<std::size_t>(at));
      }
    for (Way* way : {&from_target, &from_source})
      while (way->end == Way::End::open)
        if (climb(*way, 64, nullptr) == Climbed::restart) return Climbed::restart;

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
      if (at != visits.end() && at->frame == frame) return met(from_target, i, at->links);
    }
    return Climbed::no;
  }

 private:
  static constexpr int kNear = 48;

  const Frame* const frames_;
  Guard& guard_;
  const LinkOf link_of_;
  const std::size_t max_depth_;
};

}  // namespace ztf
