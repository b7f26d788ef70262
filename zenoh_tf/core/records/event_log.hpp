// What happened to frames that their users should hear about: time jumps, late samples, conflicts.
//
// Thread safety: every function. The mutex is taken only for rare events.
// Lock order: see tree_state.hpp.
// Invariant: bounded. Events of one kind and frame are one entry, and what finds no
// room is counted.
#pragma once

#include <algorithm>
#include <mutex>
#include <utility>
#include <vector>

#include "records/counters.hpp"
#include "records/frame.hpp"

namespace ztf {

struct TreeEvent {
  enum class Kind : std::uint8_t {
    late,        // a sample was older than the newest by more than the cache time, and not stored
    time_jump,   // a frame's history was cleared and restarted at an earlier time
    conflict,    // a frame was taken over from another authority
    reparented,  // a frame's newest parent changed
  };
  Kind kind = Kind::late;
  FrameId frame = 0;
  AuthorityId authority = 0;         // that caused the event last
  AuthorityId authority_before = 0;  // conflict: that had written the frame
  FrameId parent_before = 0;         // reparented
  Stamp stamp = kNoStamp;            // of the row
  Stamp newest = kNoStamp;           // late and time_jump: the newest sample's before
  std::uint64_t count = 1;           // how often; the other members are the last one's
};

class EventLog {
 public:
  // Allocates nothing.
  void add(const TreeEvent& event) noexcept {
    const std::lock_guard lock(mutex_);
    for (std::size_t i = 0; i < size_; ++i) {
      TreeEvent& known = events_[i];
      if (known.kind != event.kind || known.frame != event.frame) continue;
      const std::uint64_t count = known.count + event.count;
      known = event;
      known.count = count;
      return;
    }
    if (size_ == kMost)
      ++lost_;
    else
      events_[size_++] = event;
  }

  // Drops the events of frames for which is_removed(id) is true, and counts them as lost. No event
  // refers to such a frame afterwards.
  template <class IsRemoved>
  void forget(IsRemoved&& is_removed) noexcept {
    const std::lock_guard lock(mutex_);
    TreeEvent* const end = std::remove_if(
        events_, events_ + size_, [&](const TreeEvent& event) { return is_removed(event.frame); });
    const auto kept = static_cast<std::size_t>(end - events_);
    lost_ += size_ - kept;
    size_ = kept;
    for (TreeEvent* event = events_; event != end; ++event)
      if (event->parent_before != 0 && is_removed(event->parent_before)) event->parent_before = 0;
  }

  // Returns the events since the last call, and how many more found no room.
  std::pair<std::vector<TreeEvent>, std::uint64_t> take() {
    std::vector<TreeEvent> taken;
    taken.reserve(kMost);  // before the lock is taken
    const std::lock_guard lock(mutex_);
    taken.assign(events_, events_ + size_);
    size_ = 0;
    return {std::move(taken), std::exchange(lost_, 0)};
  }

 private:
  static constexpr std::size_t kMost = 64;

  // Before the mutex: after it, GCC 16 takes writes to the first event for writes beyond the mutex.
  TreeEvent events_[kMost];
  std::size_t size_ = 0;
  std::uint64_t lost_ = 0;
  std::mutex mutex_;
};

}  // namespace ztf
