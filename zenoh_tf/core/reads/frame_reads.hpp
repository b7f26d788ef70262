// Reads of a single frame: its parent at a time, and what is known of it.
//
// Thread safety: any thread. What parent_of() and info_of() return is valid only if the frame's
// version has not changed meanwhile; the others make sure of that.
#pragma once

#include "reads/walk.hpp"
#include "records/frame_info.hpp"

namespace ztf {

// Returns a frame's parent at a time, or of the newest sample for kNoStamp; 0 if there is none.
template <class Access>
FrameId parent_of(const Access& access, const Frame& frame, Stamp stamp) noexcept {
  SampleInterval interval;
  const LinkLookup link = stamp == kNoStamp ? SelectLatest{}(access, frame, interval)
                                            : SelectAt{stamp}(access, frame, interval);
  return link.status == LinkLookup::Status::ok ? link.parent : FrameId{0};
}

inline FrameInfo info_of(const Frame& frame, const FrameEvents& events, Version version) noexcept {
  const auto acquire = std::memory_order_acquire;
  FrameInfo info;
  info.version = version;
  info.parent = frame.parent.load(acquire);
  info.authority = frame.authority.load(acquire);
  info.is_static = frame.is_static.load(acquire);
  info.samples = frame.count.load(acquire);
  info.evicted = frame.evicted.load(acquire);
  info.oldest = oldest_served_stamp(frame);
  info.newest = frame.latest.stamp.load(acquire);
  info.change = events.change.load(acquire);
  info.change_stamp = events.change_stamp.load(acquire);
  info.change_authority = events.change_authority.load(acquire);
  info.authority_before = events.authority_before.load(acquire);
  info.parent_before = events.parent_before.load(acquire);
  info.static_before = events.static_before.load(acquire);
  info.pose_before = events.pose_before.load();
  return info;
}

inline FrameId read_parent(const Frame* frames, FrameId id, Stamp stamp) {
  const Frame& frame = frames[id];
  return frame.version.read_consistent(
      [&](Version) noexcept { return parent_of(FrameAccess(frames), frame, stamp); });
}

inline FrameInfo read_info(const Frame& frame, const FrameEvents& events) {
  return frame.version.read_consistent(
      [&](Version version) noexcept { return info_of(frame, events, version); });
}

// Returns the oldest stamp that a frame accepts: one that is not too old, nor older than all
// samples of a full frame. It only grows, until the history is cleared.
inline Stamp oldest_insertable(const FrameInfo& info, const Options& options) noexcept {
  if (info.samples == 0) return kNoStamp + 1;
  const Stamp by_age = span_ns(kNoStamp + 1, info.newest) <= options.cache_ns
                           ? kNoStamp + 1
                           : info.newest - static_cast<Stamp>(options.cache_ns);
  return info.samples == options.max_samples_per_frame ? std::max(by_age, info.oldest) : by_age;
}

}  // namespace ztf
