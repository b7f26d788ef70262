// One frame's history as it will be, written where no reader can see it and published as a whole.
//
// A replay writes a history so if that takes long: all frames of a message are locked at once, and
// their readers wait only while the drafts are published.
//
// Thread safety: one thread, the only one that writes the frame between construction and publish().
// Readers of the frame continue until publish().
// Invariant: the frame's own ring is only read. The first sample that is stored, or parent
// that is forgotten, moves the draft to a ring of its own, which nobody else knows.
#pragma once

#include "histories/write.hpp"

namespace ztf {

class HistoryDraft {
 public:
  // Begins with the frame's history.
  HistoryDraft(const Frame& frame, const HistoryLimits& limits, RingArena& memory) noexcept;
  // Gives back the ring of a draft that was not published.
  ~HistoryDraft();
  HistoryDraft(const HistoryDraft&) = delete;
  HistoryDraft& operator=(const HistoryDraft&) = delete;

  // Drops the history.
  void clear() noexcept { clear_history(record_); }
  // Replaces the history by a static link.
  void set_static(Stamp stamp, FrameId parent, const Pose& pose) noexcept {
    ztf::set_static(record_, stamp, parent, pose);
  }
  // Stores the samples of one commit. Throws RingArena::Full and bad_alloc.
  void store(std::span<const NewSample> samples);
  // Replaces a past parent by 0. Throws RingArena::Full and bad_alloc.
  void forget_parent(FrameId parent);

  // Gives the frame this history, and returns the ring that it had; none if it keeps that. Requires
  // the frame's write lock, and that readers wait.
  Ring publish(Frame& frame) noexcept;

 private:
  void use(PreparedRing prepared) noexcept;

  Frame record_{};  // only what a history has
  const HistoryLimits limits_;
  RingArena& memory_;
  bool owns_ring_ = false;
};

}  // namespace ztf
