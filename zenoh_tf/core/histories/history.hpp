// The folder `histories/`: the samples of one frame, in the order of their stamps.
// In: samples to insert, or a time. Out: the samples around that time, or that there are none.
// It may include geometry, records.
//
// Finding samples in one frame's history.
//
// Thread safety: any reader may call these functions at any time. After a torn read they return
// arbitrary samples of the frame, which validation of the frame's version rejects
// (records/frame.hpp). `slot` is an index into the ring, which masks it; sample i is the i-th
// oldest, in slot first + i.
// Rules (those of inserting are in histories/insert.hpp)
// 1. Between two samples of one parent the pose is interpolated. Between samples of two parents the
//    older sample holds until the newer one's time.
// 2. If there is only one sample, it serves its own time only.
// 3. A static transform serves all times.
#pragma once

#include <algorithm>
#include <bit>

#include "records/frame.hpp"

namespace ztf {

// The samples around a time: the pose at the time is interpolated between them. They are the same
// sample if that one alone gives the pose. Both always point into the frame or one of its rings,
// even after a torn read.
struct SampleInterval {
  const Sample* older;
  const Sample* newer;
  Stamp time;  // the requested time (but see PathStep)
};

// The parent that a frame has at a time, or why it has no sample then.
struct LinkLookup {
  enum class Status : std::uint8_t {
    ok,
    root,      // the frame has no parent
    no_data,   // its only sample is at another time
    backward,  // the time is before its oldest sample
    forward,   // the time is after its newest sample
  };
  Status status;
  FrameId parent;  // if not ok: the newest sample's; 0 for a root
};

// The nanoseconds between two stamps of a history, whose span fits a Stamp. The difference is
// computed unsigned, because after a torn read it may wrap around.
ZTF_ALWAYS_INLINE double elapsed_ns(Stamp from, Stamp to) noexcept {
  return static_cast<double>(static_cast<Stamp>(span_ns(from, to)));
}

// A snapshot of a history whose samples all have one parent. It guesses a time's slot from the mean
// rate of the samples. The guess is right if they come at a regular rate; if not, find() returns
// false, and the caller has to search.
class UniformHistory {
 public:
  // Requires the frame's ring, as it is now or was before.
  ZTF_ALWAYS_INLINE UniformHistory(const Frame& frame, Ring ring) noexcept
      : rate_(frame.samples_per_ns.load(std::memory_order_acquire)),
        newest_(is_rate(rate_) ? frame.latest.stamp.load(std::memory_order_acquire) : kNoStamp),
        oldest_(frame.oldest_stamp.load(std::memory_order_acquire)),
        ring_(ring),
        end_(frame.first.load(std::memory_order_acquire) +
             frame.count.load(std::memory_order_acquire)) {}

  // True if all samples have one parent, and the time lies between the oldest and the newest. No
  // rate is 1 or more (mean_sample_rate()), but untrusted memory may say so: then the slot that
  // find() computes would not fit an integer.
  [[nodiscard]] ZTF_ALWAYS_INLINE bool contains(Stamp time) const noexcept {
    return oldest_ <= time && time < newest_;
  }

  // Sets the samples around a time. Returns false if they are not where the mean rate says.
  // Requires contains(time).
  [[nodiscard]] ZTF_ALWAYS_INLINE bool find(Stamp time, SampleInterval& interval) const noexcept {
    // The number of samples between the time and the newest one.
    const auto back = static_cast<std::int64_t>(elapsed_ns(time, newest_) * rate_);
    return find_in_slot(end_ - 2 - static_cast<std::uint32_t>(back), time, interval);
  }
  // Sets the samples in a slot and in the next one. Returns false if the time is not between them.
  [[nodiscard]] ZTF_ALWAYS_INLINE bool find_in_slot(std::uint32_t slot, Stamp time,
                                                    SampleInterval& interval) const noexcept {
    interval = {&ring_.sample(slot), &ring_.sample(slot + 1), time};
    return interval.older->stamp.load(std::memory_order_acquire) <= time &&
           time < interval.newer->stamp.load(std::memory_order_acquire);
  }
  [[nodiscard]] Ring ring() const noexcept { return ring_; }

 private:
  // True above 0 and below 1, where numbers are ordered as their bits are.
  static bool is_rate(double rate) noexcept {
    constexpr auto one = std::bit_cast<std::uint64_t>(1.0);
    return std::bit_cast<std::uint64_t>(rate) - 1 < one - 1;
  }

  const double rate_;
  const Stamp newest_;  // kNoStamp, before which there is no time, without a rate
  const Stamp oldest_;
  const Ring ring_;
  const std::uint32_t end_;  // the slot after the newest sample's
};

// The slow path of find_link(): searches the ring, and decides why there is no sample.
LinkLookup find_link_by_search(const Frame& frame, Ring ring, Stamp time,
                               SampleInterval& interval) noexcept;

// Returns a frame's parent at a time and sets its samples then. If the frame has no sample at the
// time, sets the interval to the newest sample, so that a caller may read it. Requires the frame's
// ring, as it is now or was before. The caller has loaded it, as not every reader trusts its place
// (records/frame_access.hpp).
ZTF_ALWAYS_INLINE LinkLookup find_link(const Frame& frame, Ring ring, Stamp time,
                                       SampleInterval& interval) noexcept {
  using Status = LinkLookup::Status;
  const FrameId parent = frame.parent.load(std::memory_order_acquire);
  const UniformHistory history(frame, ring);
  if (history.contains(time)) [[likely]] {
    if (history.find(time, interval)) [[likely]]
      return {Status::ok, parent};
  } else if (frame.is_static.load(std::memory_order_acquire) ||
             frame.latest.stamp.load(std::memory_order_acquire) == time) {
    interval = {&frame.latest, &frame.latest, time};
    return {parent == 0 ? Status::root : Status::ok, parent};
  }
  return find_link_by_search(frame, ring, time, interval);
}

// Finds a frame's samples for many times in turn, and reads the frame only once. Where the guess by
// the rate misses and times ascend, it steps forward from the samples of the last time. Over an
// irregular history that makes Tree::lookup_batch 2.4 times as fast.
class HistoryCursor {
 public:
  HistoryCursor(const Frame& frame, Ring ring, bool ascending) noexcept
      : frame_(frame), history_(frame, ring), ascending_(ascending) {}

  // Sets the interval as find_link() does. Returns false if the frame has no sample at the time.
  ZTF_ALWAYS_INLINE bool find(Stamp time, SampleInterval& interval) noexcept {
    if (history_.contains(time) &&
        (steps_ ? step_to(time, interval) : history_.find(time, interval))) [[likely]]
      return true;
    return find_again(time, interval);
  }

 private:
  static constexpr int kSteps = 4;

  // Looks into kSteps slots from slot_ on. Requires that the sample in slot_ belongs to the history
  // and is not after the time.
  ZTF_ALWAYS_INLINE bool step_to(Stamp time, SampleInterval& interval) noexcept {
    for (int i = 0; i < kSteps; ++i, ++slot_)
      if (history_.find_in_slot(slot_, time, interval)) return true;
    return false;
  }
  [[gnu::noinline]] bool find_again(Stamp time, SampleInterval& interval) noexcept {
    const bool found =
        find_link(frame_, history_.ring(), time, interval).status == LinkLookup::Status::ok;
    slot_ = history_.ring().index_of(*interval.older);
    // False for a sample of another ring, as in a torn read.
    steps_ = ascending_ && found && interval.older != interval.newer &&
             &history_.ring().sample(slot_) == interval.older;
    return found;
  }

  const Frame& frame_;
  const UniformHistory history_;
  const bool ascending_;    // the times are given in ascending order
  bool steps_ = false;      // step_to() may be used: slot_ is valid
  std::uint32_t slot_ = 0;  // the slot of the older sample of the last time
};

// Returns the parent of the sample in a slot.
inline FrameId parent_at(const Frame& frame, Ring ring, std::uint32_t slot) noexcept {
  const auto acquire = std::memory_order_acquire;
  return frame.parent_changes.load(acquire) == 0 ? frame.parent.load(acquire) : ring.parent(slot);
}

// True if the frame never has another parent than its newest, at any time of its history.
inline bool has_one_parent(const Frame& frame) noexcept {
  const auto acquire = std::memory_order_acquire;
  return frame.is_static.load(acquire) || frame.parent_changes.load(acquire) == 0;
}

// Returns the oldest stamp that the frame can serve; its only stamp if it is static.
inline Stamp oldest_served_stamp(const Frame& frame) noexcept {
  const auto acquire = std::memory_order_acquire;
  return (frame.count.load(acquire) == 0 ? frame.latest.stamp : frame.oldest_stamp).load(acquire);
}

// Returns the parent of the oldest sample. Requires the frame's ring.
inline FrameId oldest_parent(const Frame& frame, Ring ring) noexcept {
  if (!ring || frame.count.load(std::memory_order_acquire) == 0)
    return frame.parent.load(std::memory_order_acquire);
  return parent_at(frame, ring, frame.first.load(std::memory_order_acquire));
}

// Returns whether a sample is older than newest - cache (histories/insert.hpp, rule 3).
inline bool too_old(Stamp stamp, Stamp newest, std::uint64_t cache_ns) noexcept {
  return stamp < newest && span_ns(stamp, newest) > cache_ns;
}

// Returns the mean rate in samples per nanosecond; 0 if there are fewer than two samples. Rounded
// down slightly, so that a sample's own stamp is not assigned to the slot before it. Stamps are
// distinct integers, so the rate is below 1 and elapsed_ns * rate fits int64, even after a torn
// read.
inline double mean_sample_rate(std::uint32_t count, Stamp oldest, Stamp newest) noexcept {
  return count < 2 ? 0 : (count - 1 - 1e-9) / elapsed_ns(oldest, newest);
}

}  // namespace ztf
