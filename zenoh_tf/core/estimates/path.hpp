// The links between two frames at a time, as one transaction reads them.
//
// Thread safety: a PathNow belongs to one thread. What read_path() copies is meaningful only after
// the guard has validated it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "estimates/estimate.hpp"
#include "reads/reader.hpp"

namespace ztf {

// A link selector: the link at a time, or the newest if the time is beyond it.
struct SelectReachable {
  static constexpr bool is_forest = false;
  Stamp time;
  template <class Access>
  ZTF_ALWAYS_INLINE LinkLookup operator()(const Access& access, const Frame& frame,
                                          SampleInterval& interval) const noexcept {
    const LinkLookup link = find_link(frame, access.ring(frame), time, interval);
    if (link.status == LinkLookup::Status::ok || link.status == LinkLookup::Status::root)
      return link;
    const bool is_beyond = time > frame.latest.stamp.load(std::memory_order_acquire);
    return {is_beyond ? LinkLookup::Status::ok : link.status, link.parent};
  }
};

struct StampedPose {
  Stamp stamp;
  Pose pose;
};

// Returns from - to and from + by, limited to what a Stamp holds.
inline Stamp time_between(Stamp from, Stamp to) noexcept {
  constexpr Stamp most = std::numeric_limits<Stamp>::max();
  if (to <= from) return 0;
  return static_cast<Stamp>(std::min(span_ns(from, to), static_cast<std::uint64_t>(most)));
}
inline Stamp time_after(Stamp stamp, Stamp by) noexcept {
  return stamp > std::numeric_limits<Stamp>::max() - by ? std::numeric_limits<Stamp>::max()
                                                        : stamp + by;
}
inline Stamp time_before(Stamp stamp, Stamp by) noexcept {
  return stamp < std::numeric_limits<Stamp>::min() + by ? std::numeric_limits<Stamp>::min()
                                                        : stamp - by;
}

// One link. Static links have a pose only.
struct LinkNow {
  enum class Kind : std::uint8_t {
    fixed,    // static
    exact,    // the time is a sample's
    between,  // interpolated
    carried,  // the time is beyond the newest sample
    held,     // its samples repeat an older measurement, or are stamped ahead
  };

  FrameId child, parent;
  bool inverted;  // on the target's side of the common ancestor
  Kind kind;
  bool in_gap;                              // between samples with a gap (histories/gap.hpp)
  std::uint32_t count;                      // samples of the history
  Stamp oldest, newest;                     // of the history
  Stamp beyond;                             // ns from the newest sample to the time, or 0
  Stamp lag;                                // ns since the pose was measured; 0 if between
  StampedPose older, newer;                 // the samples that give the pose
  double elapsed;                           // ns from the older one to the time
  std::array<StampedPose, kTwists> before;  // carried: kTwistSteps before the newest, or the oldest
  Stamp clock_error = 0;                    // ns by which its stamps may be off, as declared
  Stamp run_begin, run_before;  // stamps at which the newest pose, and the one before, first came;
                                // kNoStamp unless both came repeatedly

  [[nodiscard]] Pose pose() const noexcept {
    const double span = elapsed_ns(older.stamp, newer.stamp);
    return span > 0 ? interpolate(older.pose, newer.pose, elapsed / span) : older.pose;
  }
};

struct PathNow {
  SmallVector<LinkNow, 8> links;  // the factors of X_target_source, from left to right
  FrameId ancestor;
};

namespace detail {

inline bool same_pose(const AtomicPose& a, const AtomicPose& b) noexcept {
  for (int i = 0; i < 7; ++i)
    if (a[i] != b[i]) return false;
  return true;
}

// Finds when the newest pose and the one before came first, if both came at least twice: whoever
// publishes the link repeats its last measurement under new stamps.
inline void find_runs(Ring ring, std::uint32_t first, std::uint32_t count, LinkNow& link) noexcept {
  constexpr std::uint32_t kMost = 32;  // samples: runs that are longer are of a link at rest
  link.run_begin = link.run_before = kNoStamp;
  std::uint32_t begin = count - 1;
  Stamp begins[2];
  for (Stamp& at : begins) {
    const std::uint32_t end = begin;
    const std::uint32_t least = count > kMost ? count - kMost : 0;
    while (begin > least &&
           same_pose(ring.sample(first + begin - 1).pose, ring.sample(first + end).pose))
      --begin;
    if (begin == end || begin == least) return;
    at = ring.stamp(first + begin);
    --begin;
  }
  link.run_begin = begins[0];
  link.run_before = begins[1];
}

template <class Access>
void copy_link(const Access& access, const PathStep& step, Stamp time, LinkNow& link) {
  using Kind = LinkNow::Kind;
  const auto acquire = std::memory_order_acquire;
  const Frame& frame = *step.frame;
  const auto copy = [](const Sample& sample) {
    return StampedPose{sample.stamp.load(std::memory_order_acquire), sample.pose.load()};
  };
  link.older = copy(*step.interval.older);
  link.beyond = link.lag = link.clock_error = 0;
  link.run_begin = kNoStamp;
  link.in_gap = false;
  link.oldest = oldest_served_stamp(frame);
  link.newest = frame.latest.stamp.load(acquire);
  link.count = frame.count.load(acquire);
  if (frame.is_static.load(acquire)) {
    link.kind = Kind::fixed;
    link.newer = link.older;
    return;
  }
  link.newer = copy(*step.interval.newer);
  link.elapsed = elapsed_ns(link.older.stamp, time);
  link.kind = time > link.newest         ? Kind::carried
              : link.older.stamp == time ? Kind::exact
                                         : Kind::between;
  if (link.kind == Kind::between)
    link.in_gap = is_gap(frame, elapsed_ns(link.older.stamp, link.newer.stamp));
  const Ring ring = access.ring(frame);
  const std::uint32_t count = std::min(link.count, ring.capacity());
  const std::uint32_t first = frame.first.load(acquire);
  link.before.fill(link.older);
  if (!ring || count < 2) return;
  if (link.kind == Kind::carried)
    for (std::size_t i = 0; i < kTwists; ++i) {
      const std::uint32_t slot = first + count - 1 - std::min(kTwistSteps[i], count - 1);
      if (parent_at(frame, ring, slot) == link.parent) link.before[i] = copy(ring.sample(slot));
    }
  find_runs(ring, first, count, link);
}

}  // namespace detail

// Copies the links at a time, or sets the reason why there is none. Returns false if the
// transaction must be retried, like Reader's functions.
template <class AnyReader>
bool read_path(AnyReader& reader, const EstimateQuery& q, PathNow& path, Answer& a) {
  path.links.clear();
  a.failure.code = Code::ok;
  if (q.target == 0 || q.source == 0) return reader.answer({Op::at, q.target, q.source, 0}, a);
  if (q.target == q.source) return true;
  const auto copy = [&](const Chain& chain) {
    const auto& access = reader.access();
    path.ancestor = access.id_of(chain.common_ancestor);
    const std::size_t targets = chain.target.size(), sources = chain.source.size();
    LinkNow* link = path.links.append(targets + sources);
    const auto add = [&](const PathSegment& steps, std::size_t i, bool inverted) {
      link->child = access.id_of(steps[i].frame);
      link->parent = i + 1 < steps.size() ? access.id_of(steps[i + 1].frame) : path.ancestor;
      link->inverted = inverted;
      detail::copy_link(access, steps[i], q.stamp, *link++);
    };
    for (std::size_t i = 0; i < targets; ++i) add(chain.target, i, true);
    for (std::size_t i = sources; i-- > 0;) add(chain.source, i, false);
    return true;
  };
  return reader.with_chain(q.target, q.source, SelectReachable{q.stamp}, q.stamp, a, copy);
}

// Sets how long before the time each link was measured, and which links are held therefore.
void find_lags(const EstimateQuery& query, PathNow& path) noexcept;

}  // namespace ztf
