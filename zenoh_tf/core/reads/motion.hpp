// The motion of one frame in another over a span of time, copied out of a tree.
//
// A reader copies the samples of that span in one transaction, which takes microseconds. All poses
// are then computed from the copy, however many they are: of one state of the tree, and without
// blocking a writer.
//
// Thread safety: a motion belongs to one thread. What copy() gives is meaningful only after the
// guard has validated the chain (reads/guards.hpp).
#pragma once

#include <span>
#include <vector>

#include "geometry/point_map.hpp"
#include "reads/walk.hpp"

namespace ztf {

class Motion {
 public:
  // Forgets all links. The motion then is the identity at all times.
  void clear() noexcept {
    factors_.clear();
    has_gap_ = false;
  }
  // Adds the links of a chain, with all samples that times from `first` to `last` need. Requires
  // the rings of the chain's frames. Returns false after a torn read. Throws bad_alloc.
  [[nodiscard]] bool copy(const Chain& chain, std::span<const Ring> source_rings,
                          std::span<const Ring> target_rings, Stamp first, Stamp last,
                          Stamp max_gap = kNoGapLimit);
  // Whether two samples of a link are farther apart than the limit that copy() got.
  [[nodiscard]] bool has_gap() const noexcept { return has_gap_; }

  // Prepares for compute(): from then on the motion is that in the source frame as it stands at
  // that time. Throws bad_alloc.
  void fix_at(Stamp at);
  // Sets the maps of X_source(at)_source(t) for each time. Fastest for times in ascending order.
  // Requires fix_at(), times within the span, and room for a multiple of four maps.
  void compute(std::span<const Stamp> times, PointMap* maps) noexcept;

 private:
  // Two consecutive samples, and what slerp between them needs.
  struct Interval {
    Stamp from, to;
    double per_ns;       // the inverse of the time between them
    Pose older, change;  // change: of the translation; its rotation is the newer one, with the sign
                         // of the shorter arc
    double half_angle, scale;
  };
  // A factor of the product: a pose, or one that changes with time.
  struct Factor {
    Pose constant;
    std::vector<Interval> intervals;  // empty: constant
    bool inverted = false;
    std::size_t last = 0;  // the interval that was used last

    void find(Stamp time) noexcept;
  };

  static Interval interval_between(Stamp from, const Pose& older, Stamp to,
                                   const Pose& newer) noexcept;
  static Pose4 interpolate_four(Factor& factor, const Stamp* times) noexcept;
  // Adds a link. Returns false after a torn read.
  bool add(const Frame& frame, Ring ring, Stamp first, Stamp last, bool inverted, Stamp max_gap);
  // Replaces neighbouring constants by their product.
  void fold_constants();
  Pose4 product(const Stamp* times) noexcept;
  void compute_four(const Stamp* times, PointMap* maps) noexcept;

  bool has_gap_ = false;
  std::vector<Factor> factors_;  // X_fixed_source, from left to right
};

}  // namespace ztf
