// A copy of a frame's record and of its newest samples, as of one instant.
//
// Thread safety: copies are made from any thread, while others write. A copy belongs to one thread.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "records/counters.hpp"
#include "records/frame.hpp"

namespace ztf {

struct CopiedSample {
  Stamp stamp;
  FrameId parent;
  Pose pose;
};

class FrameCopy {
 public:
  Version version = 0;
  FrameId parent = 0;
  AuthorityId authority = 0;
  Stamp oldest = kNoStamp;
  std::uint32_t edits = 0;  // TreeState::edits
  bool is_static = false;

  // A static link is one sample.
  [[nodiscard]] std::span<const CopiedSample> samples() const noexcept {
    return {samples_.data(), count_};
  }

  // Copies a frame with its samples from the index first(count, stamp_at) on. `first` is called
  // once for each attempt, when all fields above are set, with the number of samples and a function
  // that returns the stamp of each; it may see a torn read. Throws bad_alloc.
  template <class First>
  void read(const Frame& frame, const std::atomic<std::uint32_t>& frame_edits, First&& first) {
    const auto attempt = [&](Version now) noexcept {
      version = now;
      return read_once(frame, frame_edits, first);
    };
    while (!frame.version.read_consistent(attempt)) samples_.resize(count_ + kSpare);
  }

 private:
  static constexpr std::size_t kSpare = 16;

  // Returns false if there is no room for all samples.
  template <class First>
  bool read_once(const Frame& frame, const std::atomic<std::uint32_t>& frame_edits,
                 First&& first) noexcept {
    constexpr auto kAcquire = std::memory_order_acquire;
    parent = frame.parent.load(kAcquire);
    authority = frame.authority.load(kAcquire);
    oldest = frame.oldest_stamp.load(kAcquire);
    edits = frame_edits.load(kAcquire);
    is_static = frame.is_static.load(kAcquire);
    const std::uint32_t count = frame.count.load(kAcquire);
    const Ring ring = frame.ring.load(kAcquire);
    const std::uint32_t begin = frame.first.load(kAcquire);
    if (is_static || !ring || count == 0 || count > ring.capacity()) {  // the last: a torn read
      const std::uint32_t links = is_static ? 1 : 0;
      count_ =
          links - first(links, [&](std::uint32_t) { return frame.latest.stamp.load(kAcquire); });
      samples_[0] = {frame.latest.stamp.load(kAcquire), parent, frame.latest.pose.load()};
      return true;
    }
    const bool has_parents = frame.parent_changes.load(kAcquire) != 0;
    const std::uint32_t from = first(count, [&](std::uint32_t i) { return ring.stamp(begin + i); });
    count_ = count - from;
    if (count_ > samples_.size()) return false;
    for (std::uint32_t i = from; i < count; ++i)
      samples_[i - from] = {ring.stamp(begin + i), has_parents ? ring.parent(begin + i) : parent,
                            ring.sample(begin + i).pose.load()};
    return true;
  }

  std::uint32_t count_ = 0;
  std::vector<CopiedSample> samples_ = std::vector<CopiedSample>(kSpare);
};

}  // namespace ztf
