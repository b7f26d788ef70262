// The one writer of histories, for commits and for replays, except appends of a single row
// (insert() of histories/insert.hpp): how samples of one frame are stored.
//
// prepare_ring() makes the ring that the samples need, if any. Many late ones are merged with the
// frame's own in one pass, while readers continue. A HistoryWriter then publishes the ring and
// stores what it does not hold yet.
//
// Thread safety: as histories/insert.hpp. prepare_ring() requires the frame's write lock, or that
// nobody else writes the tree; a HistoryWriter that readers wait, too.
#pragma once

#include "histories/insert.hpp"

namespace ztf {

// Returns the ring that the samples need; one without a ring if the frame's own has room for them.
// `oldest` is the oldest of their stamps. With `cleared`, the frame's own samples are dropped
// first. list() returns them by stamp, as merged_ring() requires. Throws RingArena::Full and
// bad_alloc.
template <class List>
PreparedRing prepare_ring(const Frame& frame, bool cleared, std::uint32_t samples, Stamp oldest,
                          List&& list, const HistoryLimits& limits, RingArena& memory) {
  if (!cleared && should_merge(frame, oldest, samples))
    return merged_ring(frame, false, list(), limits, memory);
  const std::uint64_t kept = cleared ? 0 : frame.count.load(std::memory_order_relaxed);
  if (needs_larger_ring(frame, kept, samples, limits))
    return grown_ring(frame, samples, limits, memory);
  return {};
}

class HistoryWriter {
 public:
  // Publishes the prepared ring, which is then the one that it replaced. Null: there is none.
  HistoryWriter(Frame& frame, PreparedRing* prepared, const HistoryLimits& limits) noexcept
      : frame_(frame), limits_(limits) {
    if (!prepared) return;
    publish_ring(frame, *prepared);
    is_merged_ = prepared->is_merged;
    if (is_merged_) rewritten_ = prepared->rewritten;
  }

  // Stores one of the samples that the ring was prepared for.
  void store(Stamp stamp, FrameId parent, const Pose& pose) noexcept {
    if (is_merged_) return;
    if (insert(frame_, stamp, parent, pose, limits_) == InsertResult::replaced) ++rewritten_;
  }
  // How many samples have replaced one of their stamp.
  [[nodiscard]] std::uint32_t rewritten() const noexcept { return rewritten_; }

 private:
  Frame& frame_;
  const HistoryLimits limits_;
  bool is_merged_ = false;  // the ring holds all samples already
  std::uint32_t rewritten_ = 0;
};

}  // namespace ztf
