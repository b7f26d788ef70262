// Putting samples into one frame's history.
//
// Thread safety: every function requires the frame's write lock.
#pragma once

#include <algorithm>

#include "history.hpp"

namespace ztf {

struct HistoryLimits {
  std::uint64_t cache_ns;
  std::uint32_t max_samples;
};

enum class InsertResult : std::uint8_t {
  added,
  replaced,  // a sample of the same stamp was replaced
  rejected,  // the frame is full of newer samples
};

inline void store_latest(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
  frame.parent.store(parent, std::memory_order_release);
  frame.latest.stamp.store(stamp, std::memory_order_release);
  frame.latest.pose.store(pose);
}

// Leaves the frame without samples and without a parent.
inline void clear_history(Frame& frame) noexcept {
  frame.is_static.store(false, std::memory_order_release);
  frame.samples_per_ns.store(0, std::memory_order_release);
  frame.count.store(0, std::memory_order_release);
  frame.parent.store(0, std::memory_order_release);
}

inline void set_static(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose) noexcept {
  frame.samples_per_ns.store(0, std::memory_order_release);
  frame.count.store(0, std::memory_order_release);
  frame.is_static.store(true, std::memory_order_release);
  store_latest(frame, stamp, parent, pose);
}

// Makes room for `extra` more samples, so that insert() needs none. The only
// step of a write that can fail (bad_alloc); it changes nothing a reader sees.
inline void reserve(Frame& frame, std::uint32_t extra, const HistoryLimits& limits,
                    RingArena& memory) {
  const auto relaxed = std::memory_order_relaxed;
  const Ring ring = frame.ring.load(relaxed);
  const std::uint32_t first = frame.first.load(relaxed);
  const std::uint32_t count = frame.count.load(relaxed);
  const std::uint64_t wanted =
      std::min<std::uint64_t>(std::uint64_t{count} + extra, limits.max_samples);
  if (ring && ring.capacity() >= wanted) return;
  std::uint32_t capacity = ring ? ring.capacity() : 4;
  while (capacity < wanted) capacity *= 2;
  const Ring bigger = Ring::make(capacity, memory);
  for (std::uint32_t i = 0; i < count; ++i) bigger.copy(first + i, ring, first + i);
  frame.ring.store(bigger, std::memory_order_release);
}

// For a frame that will get a sample: what its insert() mostly needs.
inline void prefetch_for_write(const Frame& frame) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const Ring ring = frame.ring.load(relaxed);
  if (!ring) return;
  const std::uint32_t first = frame.first.load(relaxed);
  ring.prefetch_for_write(first + frame.count.load(relaxed));
  ring.prefetch(first + 1);  // the oldest, once the first is pruned
}

// For who holds the frame: a locked add would wait for all the stores before it.
inline void increment(std::atomic<std::uint32_t>& counter) noexcept {
  counter.store(counter.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
}

// Whether the usual insert will do: of a sample that is newer than all, and of the same parent, and
// for which there is room, be it by eviction.
inline bool is_append(const Frame& frame, Stamp stamp, FrameId parent,
                      const HistoryLimits& limits) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const std::uint32_t count = frame.count.load(relaxed);
  return count > 0 && frame.latest.stamp.load(relaxed) < stamp &&
         frame.parent.load(relaxed) == parent && frame.parent_changes.load(relaxed) == 0 &&
         (count < frame.ring.load(relaxed).capacity() || count == limits.max_samples);
}

// Which of the ring's samples are the frame's. The last stores of an insert.
inline void publish_range(Frame& frame, std::uint32_t first, std::uint32_t count, Stamp oldest,
                          double samples_per_ns) noexcept {
  const auto release = std::memory_order_release;
  frame.oldest_stamp.store(oldest, release);
  frame.samples_per_ns.store(samples_per_ns, release);
  frame.first.store(first, release);
  frame.count.store(count, release);
}

// That insert.
inline void append(Frame& frame, Stamp stamp, const Pose& pose,
                   const HistoryLimits& limits) noexcept {
  const auto relaxed = std::memory_order_relaxed;  // the writer's own words
  const auto release = std::memory_order_release;
  const Ring ring = frame.ring.load(relaxed);
  std::uint32_t first = frame.first.load(relaxed);
  std::uint32_t count = frame.count.load(relaxed);
  Stamp oldest = frame.oldest_stamp.load(relaxed);
  if (count == limits.max_samples) increment(frame.evicted);
  ring.store(first + count, stamp, pose);
  frame.latest.stamp.store(stamp, release);
  frame.latest.pose.store(pose);
  ++count;
  while (count > limits.max_samples || too_old(oldest, stamp, limits.cache_ns)) {
    ++first;
    --count;
    oldest = ring.stamp(first);
  }
  publish_range(frame, first, count, oldest, mean_sample_rate(count, oldest, stamp));
}

InsertResult insert_out_of_order(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose,
                                 const HistoryLimits& limits) noexcept;

// Puts a sample in that is not too old, after reserve().
inline InsertResult insert(Frame& frame, Stamp stamp, FrameId parent, const Pose& pose,
                           const HistoryLimits& limits) noexcept {
  if (!is_append(frame, stamp, parent, limits))
    return insert_out_of_order(frame, stamp, parent, pose, limits);
  append(frame, stamp, pose, limits);
  return InsertResult::added;
}

}  // namespace ztf
