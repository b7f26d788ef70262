// The samples of one frame over time: finding one, and putting one in.
//
// Thread safety: find_link() for any reader (frame.hpp); the writing functions
// for who holds the frame.
// Rules (tf2's, but for those marked *)
// 1. A sample older than newest - cache is too old to be put in; one exactly
//    that old is not.
// 2. Samples are pruned after the insert*, by the same limit.
// 3. At an equal stamp the last one put in wins*.
// 4. Between two samples of one parent: interpolation. Of two parents: the
//    older sample stands until the newer one's time.
// 5. One sample serves its own time only.
// 6. Static and dynamic replace each other, and the history with it.
#pragma once

#include <algorithm>

#include "frame.hpp"

namespace ztf {

// A time and the samples on both sides of it; where they are one and the same, that is the
// answer. Always samples of the frame, in a collision with a writer whichever.
struct SampleInterval {
  const Sample* older;
  const Sample* newer;
  Stamp time;
};

// The parent that a frame has at a time, or why it has no sample then.
struct LinkLookup {
  enum class Status : std::uint8_t { ok, root, no_data, backward, forward };
  Status status;
  FrameId parent;
};

ZTF_ALWAYS_INLINE LinkLookup newest_link(const Frame& frame, LinkLookup::Status status,
                                         FrameId parent, Stamp time,
                                         SampleInterval& interval) noexcept {
  interval.older = interval.newer = &frame.latest;
  interval.time = time;
  return {status, parent};
}

// From one stamp of a history to a later one. A history is shorter than the signed
// range, which converts faster than the unsigned.
ZTF_ALWAYS_INLINE double distance(Stamp from, Stamp to) noexcept {
  return static_cast<double>(static_cast<Stamp>(span_ns(from, to)));
}

// A frame's samples as they mostly are: of one parent, and at regular times. Then a time's
// neighbours stand where its distance from the newest says.
class UniformHistory {
 public:
  // The rate first: whoever sees one, sees a ring (frame.hpp).
  ZTF_ALWAYS_INLINE explicit UniformHistory(const Frame& frame) noexcept
      : rate_(frame.samples_per_ns.load(std::memory_order_acquire)),
        newest_(frame.latest.stamp.load(std::memory_order_acquire)),
        oldest_(frame.oldest_stamp.load(std::memory_order_acquire)),
        ring_(frame.ring.load(std::memory_order_acquire)),
        end_(frame.first.load(std::memory_order_acquire) +
             frame.count.load(std::memory_order_acquire)) {}

  [[nodiscard]] Ring ring() const noexcept { return ring_; }
  [[nodiscard]] Stamp newest() const noexcept { return newest_; }
  // Whether there are samples on both sides of all times between two.
  ZTF_ALWAYS_INLINE bool spans(Stamp earliest, Stamp latest) const noexcept {
    return rate_ > 0 && oldest_ <= earliest && latest < newest_;
  }

  // Those of a time that it spans; false: they stand elsewhere. Into a reference: who copies what
  // was stored in parts just before, waits.
  ZTF_ALWAYS_INLINE bool find(Stamp time, SampleInterval& found) const noexcept {
    const auto back = static_cast<std::int64_t>(distance(time, newest_) * rate_);
    const std::uint32_t slot = end_ - 2 - static_cast<std::uint32_t>(back);
    const Sample& older = ring_.sample(slot);
    const Sample& newer = ring_.sample(slot + 1);
    if (older.stamp.load(std::memory_order_acquire) > time) [[unlikely]]
      return false;
    if (newer.stamp.load(std::memory_order_acquire) <= time) [[unlikely]]
      return false;
    found.older = &older;
    found.newer = &newer;
    found.time = time;
    return true;
  }

 private:
  const double rate_;
  const Stamp newest_, oldest_;
  const Ring ring_;
  const std::uint32_t end_;
};

// Wherever the samples are, or why there are none.
LinkLookup search(const Frame& frame, Stamp stamp, SampleInterval& interval) noexcept;

ZTF_ALWAYS_INLINE LinkLookup find_link(const Frame& frame, Stamp stamp,
                                       SampleInterval& interval) noexcept {
  const FrameId parent = frame.parent.load(std::memory_order_acquire);
  const UniformHistory history(frame);
  if (!history.spans(stamp, stamp)) [[unlikely]] {
    if (frame.latest.stamp.load(std::memory_order_acquire) != stamp &&
        !frame.is_static.load(std::memory_order_acquire))
      return search(frame, stamp, interval);
    return newest_link(frame, parent == 0 ? LinkLookup::Status::root : LinkLookup::Status::ok,
                       parent, stamp, interval);
  }
  if (!history.find(stamp, interval)) [[unlikely]]
    return search(frame, stamp, interval);
  return {LinkLookup::Status::ok, parent};
}

// The parent of the sample at an index of the ring.
inline FrameId parent_at(const Frame& frame, Ring ring, std::uint32_t slot) noexcept {
  const auto acquire = std::memory_order_acquire;
  return frame.parent_changes.load(acquire) == 0 ? frame.parent.load(acquire) : ring.parent(slot);
}

// The oldest stamp that the frame can serve; its newest where it has only one.
inline Stamp oldest_stamp(const Frame& frame) noexcept {
  const auto acquire = std::memory_order_acquire;
  return (frame.count.load(acquire) == 0 ? frame.latest.stamp : frame.oldest_stamp).load(acquire);
}

// The parent of that sample.
inline FrameId oldest_parent(const Frame& frame) noexcept {
  const Ring ring = frame.ring.load(std::memory_order_acquire);
  if (!ring || frame.count.load(std::memory_order_acquire) == 0)
    return frame.parent.load(std::memory_order_acquire);
  return parent_at(frame, ring, frame.first.load(std::memory_order_acquire));
}

inline bool too_old(Stamp stamp, Stamp newest, std::uint64_t cache_ns) noexcept {
  return stamp < newest && span_ns(stamp, newest) > cache_ns;
}

// A little less than it is: a time that is a sample's is not taken for one before it. Below 1,
// for stamps differ; so what is computed from it fits, in a collision too.
inline double mean_sample_rate(std::uint32_t count, Stamp oldest, Stamp newest) noexcept {
  return count < 2 ? 0 : (count - 1 - 1e-9) / distance(oldest, newest);
}

}  // namespace ztf
