// How a question is answered, whatever the concurrency control.
//
// Thread safety: a reader lives on its thread's stack, for one transaction.
// Every question is answered in the same steps: find the chain of links between
// the two frames, compute from it, and ask the guard whether what was read still
// stands. Failures are answers like others and rest on what was read for them.
#pragma once

#include <algorithm>
#include <vector>

#include "sample_block.hpp"

namespace ztf {

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

inline void give_range(const StampRange& range, Answer& a) noexcept {
  a.stamp = range.oldest() == kNoStamp ? 0 : range.oldest();
  a.newest = range.newest() == kNoStamp ? 0 : range.newest();
}

// Answers questions under one guard. Every function returns false to start over.
template <class Guard>
class Reader {
 public:
  Reader(const Frame* frames, Guard& guard, std::uint32_t max_depth,
         const std::atomic<bool>& ever_reparented)
      : frames_(frames), guard_(guard), max_depth_(max_depth), ever_reparented_(ever_reparented) {}

  ZTF_ALWAYS_INLINE bool answer(const Query& q, Answer& a) {
    a.failure.code = Code::ok;
    if (q.target == 0 || q.source == 0) [[unlikely]]
      if (q.op != Op::full) return unknown(q.target, q.source, a);
    switch (q.op) {
      case Op::at:
        return at(q.target, q.source, q.stamp, a);
      case Op::latest_common:
        return common(q.target, q.source, a);
      case Op::latest:
      case Op::latest_xact:
        return latest(q.target, q.source, a);
      case Op::common_time:
        return common_time(q.target, q.source, a);
      case Op::full:
        return full(q, a);
    }
    return true;
  }

  // The frames from target to source.
  bool chain(const Query& q, std::vector<FrameId>& out, Answer& a) {
    out.clear();
    a = Answer{};
    if (q.target == 0 || q.source == 0) return answer(q, a);
    if (q.target == q.source) {
      out.push_back(q.target);
      return true;
    }
    const auto list = [&](const Chain& chain) {
      const auto add = [&](const Frame* frame) { out.push_back(id_of(frame)); };
      for (std::size_t i = 0; i < chain.target.links; ++i) add(chain.target.steps[i].frame);
      add(chain.common_ancestor);
      for (std::size_t i = chain.source.links; i-- > 0;) add(chain.source.steps[i].frame);
      return true;
    };
    return q.stamp == kNoStamp ? between(q.target, q.source, SelectLatest{}, kNoStamp, a, list)
                               : between(q.target, q.source, SelectAt{q.stamp}, q.stamp, a, list);
  }

  // A block of times in one go. Where the first has no answer, only that is said.
  bool sample(SampleBlock& block) {
    const Query& q = block.first();
    Answer& a = block.first_answer();
    a.failure.code = Code::ok;
    return between(q.target, q.source, SelectAt{q.stamp}, q.stamp, a, [&](const Chain& chain) {
      if (never_reparented())
        block.answer(chain);
      else
        block.leave_unanswered();
      return true;
    });
  }

  // The newest of every link, each link consistent by itself and nothing more.
  ZTF_ALWAYS_INLINE bool latest_each(FrameId target, FrameId source, Answer& a) {
    return between(target, source, SelectLatest{}, kNoStamp, a, [&](const Chain& chain) {
      StampRange stamps;
      Pose from_source, from_target;
      if (!compose_each(chain.source, chain.common_ancestor, stamps, from_source) ||
          !compose_each(chain.target, chain.common_ancestor, stamps, from_target))
        return false;
      a.pose = chain.target.links == 0 ? from_source : inverse(from_target) * from_source;
      give_range(stamps, a);
      return true;
    });
  }

 private:
  [[nodiscard]] FrameId id_of(const Frame* frame) const noexcept {
    return static_cast<FrameId>(frame - frames_);
  }

  // Whether a chain that was found for one time is the way for others, too. Among past links there
  // can be loops, and one that the chain is a part of has another way round, over what lies above
  // the meeting point. Not as long as all links have always led where the newest ones lead, which
  // are a forest. The commit that ends this changes all frames, so what follows from it stands and
  // falls with the frames of the chain.
  [[nodiscard]] bool never_reparented() const noexcept {
    return !ever_reparented_.load(std::memory_order_seq_cst);
  }

  static bool unknown(FrameId target, FrameId source, Answer& a) {
    a = Answer{.failure = {Code::lookup, target, source}};
    return true;
  }

  // Finds the links between two frames and hands them to body(chain), or
  // explains in `a` why there are none. Then says whether what was read rests.
  template <class LinkSelector, class Body>
  ZTF_ALWAYS_INLINE bool between(FrameId target, FrameId source, LinkSelector select, Stamp stamp,
                                 Answer& a, Body body) {
    AncestorPath path(frames_ + source);
    // Mostly the target is above the source, and near.
    switch (walker(select).extend(path, 16, frames_ + target)) {
      case WalkResult::reached: {
        PathStep* const steps = path.steps.begin();
        const std::size_t links = path.steps.size();
        return body(Chain{{steps, links}, {nullptr, 0}, path.top}) && guard_.validate(steps, links);
      }
      case WalkResult::retry:
        return false;
      case WalkResult::exhausted:
        break;
    }
    return between_two_ways(path, target, select, stamp, a, body);
  }

  template <class LinkSelector, class Body>
  [[gnu::noinline]] bool between_two_ways(AncestorPath& from_source, FrameId target,
                                          LinkSelector select, Stamp stamp, Answer& a, Body body) {
    AncestorPath from_target(frames_ + target);
    Chain chain;
    switch (walker(select).find_common_ancestor(from_source, from_target, chain)) {
      case WalkResult::reached:
        if (!LinkSelector::is_forest && !never_reparented())
          return body(chain) && validate(from_source, from_target);
        return body(chain) && guard_.validate(chain.source.steps, chain.source.links) &&
               guard_.validate(chain.target.steps, chain.target.links);
      case WalkResult::retry:
        return false;
      case WalkResult::exhausted:
        break;
    }
    report_failure(from_target, from_source, stamp, a);
    return validate(from_source, from_target);
  }

  // On all of two ways: no link, or no meeting, or no other meeting.
  bool validate(const AncestorPath& from_source, const AncestorPath& from_target) {
    for (const AncestorPath* path : {&from_source, &from_target}) {
      if (!guard_.validate(path->steps.begin(), path->steps.size())) return false;
      const PathStep top{path->top, path->top_version, {}};
      if (path->end != AncestorPath::End::open && !guard_.validate(&top, 1)) return false;
    }
    return true;
  }

  template <class LinkSelector>
  ZTF_ALWAYS_INLINE Walker<Guard, LinkSelector> walker(LinkSelector select) {
    return {frames_, guard_, select, max_depth_};
  }

  // The usual lookup of newest samples in one loop, in half the time: the target
  // is above the source, and near. `one_stamp`: and all samples are of one stamp,
  // which then is the latest common time. False: it is not so, nothing is said.
  template <bool one_stamp>
  ZTF_ALWAYS_INLINE bool ascend(FrameId target, FrameId source, Answer& a) {
    constexpr std::size_t kNear = 16;
    PathStep steps[kNear];  // only what rest() asks for
    const PathStep* const last = steps + std::min<std::size_t>(kNear, max_depth_) - 1;
    PathStep* step = steps;
    StampRange stamps;
    Stamp stamp = kNoStamp;
    const Frame* const goal = frames_ + target;
    const Frame* frame = frames_ + source;
    // One link up; false: not the usual.
    const auto extend = [&]() __attribute__((always_inline)) {
      if (!guard_.read_version(*frame, step->version)) return false;
      step->frame = frame;
      const auto acquire = std::memory_order_acquire;
      const FrameId parent = frame->parent.load(acquire);
      if (parent == 0) return false;
      if (!frame->is_static.load(acquire)) {
        const Stamp own = frame->latest.stamp.load(acquire);
        if (!one_stamp) {
          stamps.include(own);
        } else if (own != stamp) {
          if (stamp != kNoStamp) return false;
          stamp = own;
        }
      }
      frame = frames_ + parent;
      return true;
    };
    if (!extend()) return false;
    Pose pose = steps[0].frame->latest.pose.load();
    while (frame != goal) {
      if (step == last) return false;
      ++step;
      const Frame* const top = frame;
      if (!extend()) return false;
      pose = top->latest.pose.load() * pose;
    }
    a.pose = pose;
    if (one_stamp)
      a.stamp = stamp == kNoStamp ? 0 : stamp;
    else
      give_range(stamps, a);
    return guard_.validate(steps, static_cast<std::size_t>(step - steps) + 1);
  }

  ZTF_ALWAYS_INLINE bool at(FrameId target, FrameId source, Stamp stamp, Answer& a) {
    a.stamp = stamp;
    a.pose = Pose{};
    if (target == source) return true;
    return between(target, source, SelectAt{stamp}, stamp, a, [&](const Chain& chain) {
      join(chain, a.pose);
      return true;
    });
  }

  ZTF_ALWAYS_INLINE bool common(FrameId target, FrameId source, Answer& a) {
    if (target == source) return lookup_self(target, 0, a);
    if (ascend<true>(target, source, a)) return true;
    return between(target, source, SelectLatest{}, kNoStamp, a, [&](const Chain& chain) {
      const StampRange stamps(chain);
      const Stamp oldest = stamps.oldest();
      a.stamp = oldest == kNoStamp ? 0 : oldest;  // static links only: any time serves
      // Mostly the links at that time are the newest ones.
      if (never_reparented() && (oldest == stamps.newest() || (go_back(chain.source, a.stamp) &&
                                                               go_back(chain.target, a.stamp)))) {
        join(chain, a.pose);
        return true;
      }
      return at(target, source, a.stamp, a);
    });
  }

  // Moves the steps of a newest way to a time; false where one of the links has no sample. They
  // lead the same way then (never_reparented()).
  static bool go_back(const PathSegment& side, Stamp stamp) noexcept {
    for (std::size_t i = 0; i < side.links; ++i) {
      PathStep& step = side.steps[i];
      if (step.interval.time == stamp || step.interval.time == kNoStamp) continue;
      if (find_link(*step.frame, stamp, step.interval).status != LinkLookup::Status::ok)
        return false;
    }
    return true;
  }

  ZTF_ALWAYS_INLINE bool latest(FrameId target, FrameId source, Answer& a) {
    if (target == source) return lookup_self(target, 0, a);
    if (ascend<false>(target, source, a)) return true;
    return between(target, source, SelectLatest{}, kNoStamp, a, [&](const Chain& chain) {
      give_range(StampRange(chain), a);
      join(chain, a.pose);
      return true;
    });
  }

  ZTF_ALWAYS_INLINE bool compose_each(const PathSegment& side, const Frame* common_ancestor,
                                      StampRange& stamps, Pose& pose) const {
    for (std::size_t i = 0; i < side.links; ++i) {
      const Frame& frame = *side.steps[i].frame;
      for (;;) {
        const Version version = frame.version.read_begin();
        const LatestLink link(frame);
        const Pose newest = frame.latest.pose.load();
        yield_point();
        if (frame.version.load() != version) continue;
        if (frames_ + link.parent != side.frame_above(i + 1, common_ancestor)) return false;
        stamps.include(link.stamp);
        pose = newest * pose;
        break;
      }
    }
    return true;
  }

  bool common_time(FrameId target, FrameId source, Answer& a) {
    a.pose = Pose{};
    if (target == source) return lookup_self(target, kNoStamp, a);
    return between(target, source, SelectLatest{}, kNoStamp, a, [&](const Chain& chain) {
      a.stamp = StampRange(chain).oldest();
      return true;
    });
  }

  bool full(const Query& q, Answer& a) {
    if (q.fixed == 0 || q.source == 0) return unknown(q.fixed, q.source, a);
    if (q.target == 0) return unknown(q.target, q.fixed, a);
    const auto leg = [&](FrameId target, FrameId source, Stamp stamp, Answer& answer) {
      return stamp == kNoStamp ? common(target, source, answer) : at(target, source, stamp, answer);
    };
    Answer first;
    if (!leg(q.fixed, q.source, q.source_stamp, first)) return false;
    if (first.failure.code != Code::ok) {
      a = first;
      return true;
    }
    if (!leg(q.target, q.fixed, q.stamp, a)) return false;
    if (a.failure.code == Code::ok) a.pose = a.pose * first.pose;
    return true;
  }

  // A frame in itself: the identity, as of its own newest sample, if it has one.
  bool lookup_self(FrameId id, Stamp timeless_stamp, Answer& a) {
    const Frame& frame = frames_[id];
    Version version;
    if (!guard_.read_version(frame, version)) return false;
    const LatestLink link(frame);
    const bool timeless = link.parent == 0 || link.stamp == kNoStamp;
    a.stamp = a.newest = timeless ? timeless_stamp : link.stamp;
    a.pose = Pose{};
    const PathStep step{&frame, version, {}};
    return guard_.validate(&step, 1);
  }

  // X_target_source = inverse(X_meeting_target) * X_meeting_source
  ZTF_ALWAYS_INLINE void join(const Chain& chain, Pose& pose) const noexcept {
    const auto [source, target, common_ancestor] = chain;
    if (source.links != 0) compose(source.steps, source.links, pose);
    if (target.links == 0) return;
    Pose from_target;
    compose(target.steps, target.links, from_target);
    pose = source.links == 0 ? inverse(from_target) : inverse(from_target) * pose;
  }

  // Two ways that did not meet: tf2's order of blame.
  void report_failure(const AncestorPath& from_target, const AncestorPath& from_source, Stamp stamp,
                      Answer& a) const {
    a = Answer{.failure = {Code::connectivity, id_of(from_target.start), id_of(from_source.start)}};
    a.failure.stamp = stamp;
    a.failure.target_root = id_of(from_target.top);
    a.failure.source_root = id_of(from_source.top);
    for (const AncestorPath* path : {&from_source, &from_target})
      if (path->end == AncestorPath::End::too_deep) {
        a.failure.code = Code::lookup;
        a.failure.frame = id_of(path->top);
        return;
      }
    for (const AncestorPath* path : {&from_target, &from_source})
      if (path->end == AncestorPath::End::no_sample) {
        const Frame& frame = *path->top;
        a.failure.code = code_of(path->failure);
        a.failure.frame = id_of(path->top);
        // The link as of the end of time that was overstepped.
        a.failure.parent = path->failure == LinkLookup::Status::backward
                               ? oldest_parent(frame)
                               : frame.parent.load(std::memory_order_acquire);
        a.failure.oldest = oldest_stamp(frame);
        a.failure.newest = frame.latest.stamp.load(std::memory_order_acquire);
        return;
      }
  }

  const Frame* frames_;
  Guard& guard_;
  const std::uint32_t max_depth_;
  const std::atomic<bool>& ever_reparented_;
};

}  // namespace ztf
