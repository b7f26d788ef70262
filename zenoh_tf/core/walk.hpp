// From two frames up to where their ways meet, and the transform between them.
//
// X_target_source = inverse(X_common_target) * X_common_source. Both ways are
// walked in turns of growing length, so that the cost follows the distance of
// the frames, not the height of the tree, and so that nothing far above the
// meeting point is read, or can disturb. Then the two ways are composed.
//
// Thread safety: values on the reader's stack. What a walk returns, failures
// included, is good only once its guard says so (guards.hpp).
#pragma once

#include "answer.hpp"
#include "guards.hpp"
#include "history.hpp"
#include "small_vector.hpp"

namespace ztf {

// How a way goes up from a frame.
struct Link {
  Place::Kind kind;  // root where there is no link
  FrameId parent;
  std::uint32_t slot;
  Stamp stamp;  // newest links: kNoStamp where static, good for all times
};

struct NewestLink {
  ZTF_HOT Link operator()(const Frame& frame) const noexcept {
    const auto acquire = std::memory_order_acquire;
    const FrameId parent = frame.parent.load(acquire);
    const Stamp stamp =
        frame.is_static.load(acquire) ? kNoStamp : frame.latest_stamp.load(acquire);
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

// A link of a way, as read.
struct Step {
  Version version;
  Stamp stamp;
  std::uint32_t slot;
};

// One way up. frames[0] is the start, the last one the top; steps[i] is the
// link from frames[i] to frames[i + 1].
struct Way {
  enum class End : std::uint8_t { open, root, broken, too_deep };

  explicit Way(FrameId start) { frames.push_back(start); }

  SmallVector<FrameId, 48> frames;
  SmallVector<Step, 48> steps;
  Version top_version = 0;            // where it ended at a root, or broken
  End end = End::open;
  Place::Kind why = Place::Kind::ok;  // where broken: at the top, for this reason

  [[nodiscard]] FrameId top() const noexcept { return frames.back(); }

  // Where `frame` stands in this way, or -1. In blocks, which compilers vectorise.
  [[nodiscard]] std::ptrdiff_t find(FrameId frame) const noexcept {
    const FrameId* const data = frames.begin();
    const std::size_t n = frames.size();
    std::size_t i = 0;
    for (; i + 16 <= n; i += 16) {
      std::uint32_t hit = 0;
      for (std::size_t j = 0; j < 16; ++j) hit |= static_cast<std::uint32_t>(data[i + j] == frame);
      if (hit) break;
    }
    for (; i < n; ++i)
      if (data[i] == frame) return static_cast<std::ptrdiff_t>(i);
    return -1;
  }
};

enum class Walked : std::uint8_t { met, apart, restart };

template <class Guard, class LinkOf>
class Walk {
 public:
  Walk(const Frame* frames, Guard& guard, LinkOf link_of, std::uint32_t max_depth, FrameId target,
       FrameId source)
      : from_target(target), from_source(source), frames_(frames), guard_(guard),
        link_of_(link_of), max_depth_(max_depth) {}

  Way from_target, from_source;
  std::size_t target_links = 0, source_links = 0;  // up to the meeting point, if met

  Walked run() {
    for (std::size_t turn = 8;; turn *= 2) {
      if (climb(from_source, from_target, turn)) {
        source_links = from_source.steps.size();
        target_links = met_at_;
        return Walked::met;
      }
      if (restart_) return Walked::restart;
      if (climb(from_target, from_source, turn)) {
        target_links = from_target.steps.size();
        source_links = met_at_;
        return Walked::met;
      }
      if (restart_) return Walked::restart;
      if (from_source.end != Way::End::open && from_target.end != Way::End::open)
        return Walked::apart;
    }
  }

  // What the answer rests on: the links between the two frames if they met,
  // else everything that was read.
  void keep_reads(bool met) {
    keep(from_source, met ? source_links : from_source.steps.size());
    keep(from_target, met ? target_links : from_target.steps.size());
    if (met) return;
    for (const Way* way : {&from_source, &from_target})
      if (way->end != Way::End::too_deep) guard_.keep(way->top(), way->top_version);
  }

 private:
  // Up to `turn` links; true where it steps onto a frame of the other way.
  bool climb(Way& way, const Way& other, std::size_t turn) {
    if (way.end != Way::End::open) return false;
    std::size_t n = way.steps.size();
    const std::size_t until = std::min<std::size_t>(n + turn, max_depth_);
    FrameId* const frames = way.frames.reserve(until - n);
    Step* const steps = way.steps.reserve(until - n);
    FrameId id = frames[n];
    bool met = false;
    // At first the other way is its start alone: one comparison, no search.
    const FrameId other_start = other.frames[0];
    const bool search = other.frames.size() > 1;
    while (n < until) {
      const Frame& frame = frames_[id];
      Version version;
      if (!guard_.enter(id, frame, version)) [[unlikely]] {
        restart_ = true;
        break;
      }
      const Link link = link_of_(frame);
      if (link.kind != Place::Kind::ok || link.parent == 0) [[unlikely]] {
        way.why = link.kind;
        way.top_version = version;
        way.end = link.kind == Place::Kind::root ? Way::End::root : Way::End::broken;
        break;
      }
      steps[n] = {version, link.stamp, link.slot};
      frames[++n] = id = link.parent;
      if (id == other_start) {
        met_at_ = 0;
        met = true;
        break;
      }
      if (search) {
        const std::ptrdiff_t at = other.find(id);
        if (at >= 0) {
          met_at_ = static_cast<std::size_t>(at);
          met = true;
          break;
        }
      }
    }
    way.frames.set_size(n + 1);
    way.steps.set_size(n);
    if (!met && n == max_depth_ && way.end == Way::End::open) way.end = Way::End::too_deep;
    return met;
  }

  void keep(const Way& way, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) guard_.keep(way.frames[i], way.steps[i].version);
  }

  const Frame* frames_;
  Guard& guard_;
  LinkOf link_of_;
  std::size_t max_depth_;
  std::size_t met_at_ = 0;
  bool restart_ = false;
};

}  // namespace ztf
