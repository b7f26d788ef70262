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

// How a way goes up from a frame.
struct Link {
  Place::Kind kind;  // root where there is no link
  FrameId parent;
  std::uint32_t slot;
  Stamp stamp;
};

struct NewestLink {
  ZTF_HOT Link operator()(const Frame& frame) const noexcept {
    const auto acquire = std::memory_order_acquire;
    const FrameId parent = frame.parent.load(acquire);
    const Stamp stamp = frame.is_static.load(acquire) ? kNoStamp : frame.latest_stamp.load(acquire);
    return {parent == 0 ? Place::Kind::root : Place::Kind::ok, parent, Place::kNewest, stamp};
  }
};

struct LinkAt {
  Stamp at;
  ZTF_HOT Link operator()(const Frame& frame) const noexcept {
    const Place place = place_at(frame, at);
    return {place.kind, place.parent, place.slot, at};
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
  Version top_version = 0;            // where it ended at a root, or broken
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

// Oldest and newest of some links' stamps; static ones are of all times and do
// not count.
class StampRange {
 public:
  ZTF_HOT void include(Stamp stamp) noexcept {
    oldest_ = std::min(oldest_, rank(stamp));
    newest_ = std::max(newest_, stamp);
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

enum class Walked : std::uint8_t { met, apart, restart };

template <class Guard, class LinkOf>
class Walk {
 public:
  ZTF_HOT Walk(const Frame* frames, Guard& guard, LinkOf link_of, std::uint32_t max_depth,
               FrameId target, FrameId source) noexcept
      : from_source(frames + source), from_target(frames + target), frames_(frames), guard_(guard),
        link_of_(link_of), max_depth_(max_depth) {}

  Way from_source, from_target;
  std::size_t source_links = 0, target_links = 0;  // up to the meeting point, if met
  StampRange range;                                // of these links

  ZTF_HOT Walked run() {
    // Mostly the target is above the source, and near.
    if (climb(from_source, 16, from_target.start)) {
      source_links = from_source.steps.size();
      return Walked::met;
    }
    return search();
  }

  // What the answer rests on: the links between the two frames if they met,
  // else everything that was read. False: not any more.
  ZTF_HOT bool rest(bool met) {
    if (met)
      return guard_.rest(from_source.steps.begin(), source_links) &&
             guard_.rest(from_target.steps.begin(), target_links);
    for (const Way* way : {&from_source, &from_target}) {
      if (!guard_.rest(way->steps.begin(), way->steps.size())) return false;
      const Step top{way->top, way->top_version, 0, 0};
      if (way->end != Way::End::too_deep && !guard_.rest(&top, 1)) return false;
    }
    return true;
  }

 private:
  // Up to `turn` links; true where that reaches `goal`.
  ZTF_HOT bool climb(Way& way, std::size_t turn, const Frame* goal) {
    std::size_t n = way.steps.size();
    const std::size_t until = std::min<std::size_t>(n + turn, max_depth_);
    Step* const steps = way.steps.reserve(until - n);
    const Frame* frame = way.top;
    while (n < until && way.end == Way::End::open) {
      Version version;
      if (!guard_.enter(*frame, version)) [[unlikely]] {
        restart_ = true;
        break;
      }
      const Link link = link_of_(*frame);
      if (link.kind != Place::Kind::ok || link.parent == 0) [[unlikely]] {
        way.why = link.kind;
        way.top_version = version;
        way.end = link.kind == Place::Kind::root ? Way::End::root : Way::End::broken;
        break;
      }
      steps[n++] = {frame, version, link.stamp, link.slot};
      range.include(link.stamp);
      frame = frames_ + link.parent;
      if (frame == goal) break;
    }
    way.top = frame;
    way.steps.set_size(n);
    if (frame == goal) return true;
    if (n == max_depth_ && way.end == Way::End::open) way.end = Way::End::too_deep;
    return false;
  }

  [[gnu::noinline]] Walked search() {
    for (int i = 0; i < kNear && !restart_; ++i)
      for (Way* way : {&from_target, &from_source}) {
        if (way->end != Way::End::open) continue;
        climb(*way, 1, nullptr);
        const Way& other = way == &from_source ? from_target : from_source;
        const std::ptrdiff_t at = other.find(way->top);
        if (at >= 0) return meet(*way, way->steps.size(), static_cast<std::size_t>(at));
      }
    for (Way* way : {&from_target, &from_source})
      while (way->end == Way::End::open && !restart_) climb(*way, 64, nullptr);
    if (restart_) return Walked::restart;

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
      if (at != visits.end() && at->frame == frame) return meet(from_target, i, at->links);
    }
    return Walked::apart;
  }

  Walked meet(const Way& way, std::size_t links, std::size_t other_links) noexcept {
    const bool source = &way == &from_source;
    source_links = source ? links : other_links;
    target_links = source ? other_links : links;
    range = StampRange{};
    for (std::size_t i = 0; i < source_links; ++i) range.include(from_source.steps[i].stamp);
    for (std::size_t i = 0; i < target_links; ++i) range.include(from_target.steps[i].stamp);
    return Walked::met;
  }

  static constexpr int kNear = 48;

  const Frame* frames_;
  Guard& guard_;
  LinkOf link_of_;
  const std::size_t max_depth_;
  bool restart_ = false;
};

}  // namespace ztf
