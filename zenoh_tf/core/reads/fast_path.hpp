// The fast path of lookups of the newest samples: a near ancestor as the target.
//
// It composes the poses while it walks, and keeps only the frames' versions. Over 4 links the
// latest common lookup takes 23 ns instead of 62, and the newest samples at one instant 23 instead
// of 42. Everything else takes the general walk (reads/walk.hpp).
//
// Thread safety: any reader, under a guard of its own (reads/guards.hpp).
#pragma once

#include "reads/answer.hpp"
#include "reads/walk.hpp"

namespace ztf {

// Sets X_target_source of the newest links, adds their stamps to the range, and validates what it
// read. Returns false if the caller must use the general walk, with a new range. Then the target is
// not within kDirectLinks above the source, validation has failed, or the links differ in their
// stamps although `one_stamp` is set. Requires target != source.
template <class Access, class Guard>
ZTF_ALWAYS_INLINE bool compose_newest_links(const Access& access, Guard& guard,
                                            std::size_t max_depth, FrameId target, FrameId source,
                                            bool one_stamp, StampRange& stamps, Pose& pose) {
  PathStep steps[kDirectLinks];
  const std::size_t limit = std::min(kDirectLinks, max_depth);
  const Frame* const goal = access.frame(target);
  const Frame* frame = access.frame(source);
  std::size_t links = 0;
  Pose product;
  do {
    if (links == limit) return false;
    PathStep& step = steps[links++];
    step.frame = frame;
    if (!guard.read_version(*frame, step.version)) return false;
    const LatestLink link(*frame);
    if (link.parent == 0) return false;
    stamps.include(link.stamp);
    if (one_stamp && !stamps.all_equal()) return false;
    product = links == 1 ? frame->latest.pose.load() : frame->latest.pose.load() * product;
    frame = access.frame(link.parent);
  } while (frame != goal);
  pose = product;
  return guard.validate({steps, links});
}

}  // namespace ztf
