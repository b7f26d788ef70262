// How each kind of query is answered, whatever the concurrency control.
//
// Every query is answered in the same steps: find the chain of links between the two frames,
// compute the answer from the chain, and let the guard validate what was read. A failure is an
// answer, too, and is validated alike.
//
// Thread safety: a reader belongs to one thread and one transaction.
#pragma once

#include <algorithm>
#include <unordered_set>
#include <vector>

#include "reads/answer.hpp"
#include "reads/fast_path.hpp"
#include "reads/motion.hpp"
#include "reads/sample_block.hpp"

namespace ztf {

// Answers queries under one guard. Every public function returns false if the transaction must
// be retried; then its outputs are unspecified.
template <class Guard, class Access>
class Reader {
 public:
  Reader(const Access& access, Guard& guard, std::uint32_t max_depth,
         const std::atomic<bool>& ever_reparented, const std::atomic<std::uint64_t>& ids_freed)
      : access_(access),
        guard_(guard),
        max_depth_(max_depth),
        ever_reparented_(ever_reparented),
        ids_freed_(ids_freed) {}

  // Whether all that was read so far was the tree's state at one instant. Requires a guard that
  // records what it reads.
  [[nodiscard]] bool is_valid() const { return guard_.validate_all(); }

  // Answers one query of any kind.
  ZTF_ALWAYS_INLINE bool answer(const Query& q, Answer& a) {
    a.failure.code = Code::ok;
    a.gap = 0;
    if (q.target == 0 || q.source == 0) [[unlikely]]
      if (q.op != Op::full) return report_unknown(q.target, q.source, a);
    switch (q.op) {
      case Op::at:
        return lookup_at(q.target, q.source, q.stamp, q.max_gap, a);
      case Op::latest_common:
        return lookup_latest_common(q.target, q.source, q.max_gap, a);
      case Op::latest:
        // It promises less than latest_xact, so one answer serves both.
      case Op::latest_xact:
        return lookup_latest(q.target, q.source, a);
      case Op::common_time:
        return lookup_common_time(q.target, q.source, a);
      case Op::full:
        return lookup_full(q, a);
    }
    return true;
  }

  // Lists the frames from the target to the source, at Query::stamp or along the newest links.
  bool chain(const Query& q, std::vector<FrameId>& out, Answer& a) {
    out.clear();
    a = Answer{};
    if (q.target == 0 || q.source == 0) return answer(q, a);
    if (q.target == q.source) {
      out.push_back(q.target);
      return true;
    }
    const auto list = [&](const Chain& chain) {
      for (const PathStep& step : chain.target) out.push_back(id_of(step.frame));
      out.push_back(id_of(chain.common_ancestor));
      for (auto step = chain.source.rbegin(); step != chain.source.rend(); ++step)
        out.push_back(id_of(step->frame));
      return true;
    };
    if (q.stamp == kNoStamp)
      return with_chain(q.target, q.source, SelectLatest{}, kNoStamp, a, list);
    return with_chain(q.target, q.source, SelectAt{q.stamp}, q.stamp, a, list);
  }

  // Calls visit(id, frame, parent, version) for the frames from each start up to its root, each
  // frame once. The links are those at `stamp`, and the newest where a frame has none at that time;
  // kNoStamp means the newest ones.
  template <class Visit>
  bool visit_ancestors(std::span<const FrameId> starts, Stamp stamp, Visit visit) {
    std::unordered_set<FrameId> seen;
    for (FrameId id : starts) {
      for (std::uint32_t depth = 0; id != 0 && depth <= max_depth_; ++depth) {
        if (!seen.insert(id).second) break;
        const Frame& frame = *access_.frame(id);
        id = id_of(&frame);  // of corrupt mapped memory it is another one
        PathStep step{&frame, 0, {}};
        if (!guard_.read_version(frame, step.version)) return false;
        FrameId parent = 0;
        if (stamp != kNoStamp) {
          const LinkLookup link = SelectAt{stamp}(access_, frame, step.interval);
          if (link.status == LinkLookup::Status::ok) parent = link.parent;
        }
        if (parent == 0) parent = LatestLink(frame).parent;
        visit(id, frame, parent, step.version);
        if (!guard_.validate({&step, 1})) return false;
        id = parent;
      }
    }
    return true;
  }

  // Answers the rows of a block that one chain serves, and marks the others as unanswered. If there
  // is no chain at the first row's time, reports only that row's failure.
  bool answer_block(SampleBlock& block) {
    const Query& q = block.first();
    Answer& a = block.first_answer();
    a.failure.code = Code::ok;
    return with_chain(q.target, q.source, SelectAt{q.stamp}, q.stamp, a, [&](const Chain& chain) {
      return with_all_times(chain, [&](bool serves_all_times) {
        if (serves_all_times)
          with_rings(chain,
                     [&](auto source, auto target) { block.compute(chain, source, target); });
        else
          block.leave_unanswered();
        return true;
      });
    });
  }

  // Copies the motion of the source in the fixed frame. If that cannot be looked up at one of the
  // query's times, `a` is the failure; else `result` says whether the motion was copied.
  bool copy_motion(const MotionQuery& q, Motion& motion, MotionResult& result, Answer& a) {
    motion.clear();
    result = MotionResult::copied;
    for (const Stamp time : {q.at, q.first, q.last}) {
      if (!answer(query_at_time(q.fixed, q.source, time, q.max_gap), a)) return false;
      if (a.failure.code != Code::ok) return true;
    }
    if (q.fixed == q.source) return true;
    return with_chain(q.fixed, q.source, SelectAt{q.at}, q.at, a, [&](const Chain& chain) {
      return with_all_times(chain, [&](bool serves_all_times) {
        if (!serves_all_times) {
          result = MotionResult::varies;
          return true;
        }
        return with_rings(chain, [&](std::span<const Ring> source, std::span<const Ring> target) {
          const Stamp first = std::min(q.at, q.first), last = std::max(q.at, q.last);
          if (!motion.copy(chain, source, target, first, last, q.max_gap)) return false;
          if (motion.has_gap()) result = MotionResult::varies;
          return true;
        });
      });
    });
  }

  [[nodiscard]] const Access& access() const noexcept { return access_; }

  // Finds the chain between two frames and calls body(chain), or reports in `a` why there is none.
  // Then validates what was read. `stamp` is the time that a failure reports: that of SelectAt, or
  // kNoStamp for SelectLatest.
  template <class LinkSelector, class Body>
  ZTF_ALWAYS_INLINE bool with_chain(FrameId target, FrameId source, LinkSelector select,
                                    Stamp stamp, Answer& a, Body body) {
    AncestorPath from_source(access_.frame(source)), from_target(access_.frame(target));
    Chain chain;
    Walker<Access, Guard, LinkSelector> walker(access_, guard_, select, max_depth_);
    switch (walker.find_chain(from_source, from_target, chain)) {
      case WalkResult::reached:
        if (!body(chain)) return false;
        // Past links may form a loop. Then there may be two chains, and which one is found depends
        // on frames outside it. So every frame that was read is validated.
        if (!LinkSelector::is_forest && !never_reparented())
          return validate(from_source) && validate(from_target);
        return guard_.validate(chain.source) && guard_.validate(chain.target);
      case WalkResult::retry:
        return false;
      case WalkResult::exhausted:
        break;
    }
    // Before the paths are validated: a frame on them that loses a parent's id gets a new version.
    const std::uint64_t ids_freed = ids_freed_.load(std::memory_order_acquire);
    report_failure(access_, from_target, from_source, stamp, a);
    a.failure.ids_freed = ids_freed;
    if (stamp != kNoStamp && !name_farthest_link(access_, guard_, max_depth_, target, source, a))
      return false;
    return validate(from_source) && validate(from_target);
  }

  // Calls body(frame), and validates what it has read of the frame.
  template <class Body>
  bool with_frame(FrameId id, Body&& body) {
    PathStep step{access_.frame(id), 0, {}};
    if (!guard_.read_version(*step.frame, step.version)) return false;
    body(*step.frame);
    return guard_.validate({&step, 1});
  }

 private:
  [[nodiscard]] FrameId id_of(const Frame* frame) const noexcept { return access_.id_of(frame); }

  // Returns body(source_rings, target_rings).
  template <class Body>
  auto with_rings(const Chain& chain, Body&& body) const {
    SmallVector<Ring, 32> source, target;
    for (const PathStep& step : chain.source) source.push_back(access_.ring(*step.frame));
    for (const PathStep& step : chain.target) target.push_back(access_.ring(*step.frame));
    return body(std::span<const Ring>(source.begin(), source.size()),
                std::span<const Ring>(target.begin(), target.size()));
  }

  // True if no frame ever had samples of two parents in its history. Then a chain found for one
  // time serves all times. Otherwise past links may form loops, with two chains between the same
  // frames. The first commit that makes it false changes the versions of all frames. So validating
  // a chain's frames also validates a decision that rests on this.
  [[nodiscard]] bool never_reparented() const noexcept {
    return !ever_reparented_.load(std::memory_order_seq_cst);
  }

  // Calls body(serves_all_times), and validates what that rests on beside the chain: whether the
  // chain is that of all times at which its links have samples. Returns false if body() does.
  template <class Body>
  ZTF_ALWAYS_INLINE bool with_all_times(const Chain& chain, Body&& body) {
    if (never_reparented()) [[likely]]
      return body(true);
    SmallVector<PathStep, 32> above;
    bool serves = false;
    return read_above(chain, above, serves) && body(serves) &&
           guard_.validate({above.begin(), above.size()});
  }

  // Decides whether a chain serves all times although frames were reparented, and lists in `above`
  // the frames beside the chain that the decision rests on. Returns false if the guard demands a
  // retry.
  //
  // It does if no frame of the chain, nor of the newest path from the common ancestor to the root,
  // has samples of two parents. At any time each of these frames has its newest parent or none, and
  // they include all frames above them. So the walks from both frames stay on their newest paths,
  // which are simple and meet first in the common ancestor. One frame above with a past parent
  // could close a loop at that time, back into the chain, and the walks could meet elsewhere. A
  // direct chain is found before the walk reads the frames above (Walker::find_chain).
  [[gnu::noinline]] bool read_above(const Chain& chain, SmallVector<PathStep, 32>& above,
                                    bool& serves) {
    for (const PathSegment steps : {chain.source, chain.target})
      for (const PathStep& step : steps)
        if (!has_one_parent(*step.frame)) return true;
    serves = chain.target.empty() && chain.source.size() <= kDirectLinks;
    const Frame* frame = chain.common_ancestor;
    for (std::uint32_t depth = 0; !serves && depth <= max_depth_; ++depth) {
      PathStep step{frame, 0, {}};
      if (!guard_.read_version(*frame, step.version)) return false;
      above.push_back(step);
      const FrameId parent = LatestLink(*frame).parent;
      if (parent != 0 && !has_one_parent(*frame)) return true;
      serves = parent == 0;
      frame = access_.frame(parent);
    }
    return true;
  }

  // Validates a whole path. If it has an end, validates the frame at the end, too.
  bool validate(AncestorPath& path) {
    if (!guard_.validate({path.steps.begin(), path.steps.size()})) return false;
    if (path.state == AncestorPath::State::open) return true;
    const PathStep last{path.highest, path.highest_version, {}};
    return guard_.validate({&last, 1});
  }

  ZTF_ALWAYS_INLINE bool lookup_at(FrameId target, FrameId source, Stamp stamp, Stamp max_gap,
                                   Answer& a) {
    a.stamp = stamp;
    a.pose = Pose{};
    if (target == source) return true;
    return with_chain(target, source, SelectAt{stamp}, stamp, a, [&](const Chain& chain) {
      a.gap = compose_chain(chain, a.pose);
      if (max_gap != kNoGapLimit) [[unlikely]]
        check_gaps(access_, chain, max_gap, {target, source}, ids_freed_, a);
      return true;
    });
  }

  ZTF_ALWAYS_INLINE bool lookup_latest_common(FrameId target, FrameId source, Stamp max_gap,
                                              Answer& a) {
    if (target == source) return lookup_self(target, 0, a);
    StampRange newest;
    if (compose_newest_links(access_, guard_, max_depth_, target, source, true, newest, a.pose)) {
      a.stamp = oldest_or_zero(newest);
      return true;
    }
    return with_chain(target, source, SelectLatest{}, kNoStamp, a, [&](const Chain& chain) {
      a.stamp = oldest_or_zero(stamps_of(chain));
      return with_all_times(chain, [&](bool serves_all_times) {
        if (!serves_all_times || !move_to_time(chain.source, a.stamp) ||
            !move_to_time(chain.target, a.stamp))
          return lookup_at(target, source, a.stamp, max_gap, a);
        a.gap = compose_chain(chain, a.pose);
        if (max_gap != kNoGapLimit) [[unlikely]]
          check_gaps(access_, chain, max_gap, {target, source}, ids_freed_, a);
        return true;
      });
    });
  }

  ZTF_ALWAYS_INLINE bool lookup_latest(FrameId target, FrameId source, Answer& a) {
    if (target == source) return lookup_self(target, 0, a);
    StampRange newest;
    if (compose_newest_links(access_, guard_, max_depth_, target, source, false, newest, a.pose)) {
      set_stamps(newest, a);
      return true;
    }
    return with_chain(target, source, SelectLatest{}, kNoStamp, a, [&](const Chain& chain) {
      set_stamps(stamps_of(chain), a);
      compose_chain(chain, a.pose);
      return true;
    });
  }

  bool lookup_common_time(FrameId target, FrameId source, Answer& a) {
    a.pose = Pose{};
    if (target == source) return lookup_self(target, kNoStamp, a);
    return with_chain(target, source, SelectLatest{}, kNoStamp, a, [&](const Chain& chain) {
      const StampRange stamps = stamps_of(chain);
      a.stamp = stamps.empty() ? kNoStamp : stamps.oldest();
      return true;
    });
  }

  // Source to fixed at the source's stamp, then fixed to target at the target's stamp.
  bool lookup_full(const Query& q, Answer& a) {
    if (q.fixed == 0 || q.source == 0) {
      (void)report_unknown(q.fixed, q.source, a);
      a.failure.source_half = true;
      return true;
    }
    if (q.target == 0) return report_unknown(q.target, q.fixed, a);
    const auto lookup = [&](FrameId target, FrameId source, Stamp stamp, Answer& answer) {
      return stamp == kNoStamp ? lookup_latest_common(target, source, q.max_gap, answer)
                               : lookup_at(target, source, stamp, q.max_gap, answer);
    };
    Answer first;
    if (!lookup(q.fixed, q.source, q.source_stamp, first)) return false;
    if (first.failure.code != Code::ok) {
      a = first;
      a.failure.source_half = true;
      return true;
    }
    if (!lookup(q.target, q.fixed, q.stamp, a)) return false;
    a.failure.source_half = false;
    if (a.failure.code != Code::ok) return true;
    a.pose = a.pose * first.pose;
    a.gap = std::max(a.gap, first.gap);
    return true;
  }

  // Answers the lookup of a frame in itself: the identity, with the stamp of its newest sample. For
  // a root or a static frame the stamp is `timeless_stamp`, which is kNoStamp for common_time.
  bool lookup_self(FrameId id, Stamp timeless_stamp, Answer& a) {
    const Frame& frame = *access_.frame(id);
    Version version;
    if (!guard_.read_version(frame, version)) return false;
    const LatestLink link(frame);
    const bool timeless = link.parent == 0 || link.stamp == kNoStamp;
    a.stamp = a.newest = timeless ? timeless_stamp : link.stamp;
    a.pose = Pose{};
    const PathStep step{&frame, version, {}};
    return guard_.validate({&step, 1});
  }

  // Sets the intervals of newest links to an earlier time. Returns false if a link has no sample
  // then. Requires that the chain serves all times (with_all_times()).
  bool move_to_time(PathSegment steps, Stamp time) const noexcept {
    for (PathStep& step : steps) {
      if (step.interval.time == time || step.interval.time == kNoStamp) continue;
      const Ring ring = access_.ring(*step.frame);
      if (find_link(*step.frame, ring, time, step.interval).status != LinkLookup::Status::ok)
        return false;
    }
    return true;
  }

  // Sets X_target_source = inverse(X_ancestor_target) * X_ancestor_source. Returns the longest gap,
  // as compose() does. Requires at least one link.
  ZTF_ALWAYS_INLINE static Stamp compose_chain(const Chain& chain, Pose& pose) noexcept {
    const Stamp gap = chain.source.empty() ? 0 : compose(chain.source, pose);
    if (chain.target.empty()) return gap;
    Pose from_target;
    const Stamp target_gap = compose(chain.target, from_target);
    pose = chain.source.empty() ? inverse(from_target) : inverse(from_target) * pose;
    return std::max(gap, target_gap);
  }

  static bool report_unknown(FrameId target, FrameId source, Answer& a) {
    a = Answer{.failure = {.code = Code::lookup, .target = target, .source = source}};
    return true;
  }

  const Access access_;
  Guard& guard_;
  const std::uint32_t max_depth_;
  const std::atomic<bool>& ever_reparented_;
  const std::atomic<std::uint64_t>& ids_freed_;
};

}  // namespace ztf
