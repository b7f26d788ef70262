// The folder `waiting/`: lookups that wait for a commit.
// In: a query, then the frames and names of each commit. Out: a call once the lookup may succeed.
// It may include base, records, reads.
//
// Lookups that wait for a commit, and which commit wakes which of them.
//
// A lookup that failed, but may succeed later, is parked under the frames that its failure rests on
// and under the names that it misses. A commit wakes the lookups parked under its frames whose
// result it may have changed; a woken lookup runs again. This costs a commit one load while no
// lookup waits, else one load for each of its frames.
//
// Thread safety: every function, from any thread. A waiter belongs to one thread at a time:
// lookup_or_park() (lookups/park.hpp) takes it over, and keeps it if it parks it. cancel() that
// returns true, or notify(), gives it back.
// Lock order: see tree_state.hpp. Under the list's mutex a frame may be read, which may take its
// writer lock for a moment (SeqLock::read_consistent), and a waiter's notify() its own locks. That
// cannot deadlock, because no thread takes the list's mutex while it holds one of those.
//
// Why no wake-up is lost. Four steps are sequentially consistent, two of each side:
//   lookup_or_park():  W1 marks the frames as waited for;  W2 reads the commit count.
//   a commit:          C1 counts itself;                   C2 reads the marks of its frames.
// In the single order of these steps either W1 precedes C2 or C1 precedes W2.
// - W1 before C2: the commit sees the mark and takes the list's mutex. Parking completed under that
//   mutex, so the commit finds the waiter and wakes it, with the exception below.
// - C1 before W2: the commit unlocked its frames before C1, so that happens before what
//   lookup_or_park() does after W2: it compares the frames' versions with those that the lookup
//   read, sees the new version, and runs the lookup again.
// The exception: notify_frame(appended) wakes selectively. It may pass over a waiter that was
// parked by the parent that it read after the commit. The commit's unlock happened before that
// read, so the comparison after W2 sees the new version. Both cases therefore need the comparison.
// The same holds for names, with WaitList::size() as the mark. Names are compared by their ids,
// and how many names these have had.
#pragma once

#include <map>
#include <mutex>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "base/options.hpp"
#include "reads/guards.hpp"
#include "reads/query.hpp"
#include "records/frame_info.hpp"
#include "system/zeroed_array.hpp"

namespace ztf {

struct TreeState;

// One waiting lookup. Derived classes say how it is woken. They must call WaitList::cancel() in
// their destructor. A waiter must outlive each call of lookup_or_park(), even if notify() runs
// meanwhile.
class Waiter {
 public:
  // The query's ids are looked up by these names, which must outlive the waiter.
  Waiter(const Query& query, std::string_view target, std::string_view source,
         std::string_view fixed = {})
      : query_(query), target_(target), source_(source), fixed_(fixed) {}
  virtual ~Waiter() = default;
  Waiter(const Waiter&) = delete;
  Waiter& operator=(const Waiter&) = delete;

  // The query and the answer of the last lookup_or_park().
  [[nodiscard]] const Query& query() const noexcept { return query_; }
  [[nodiscard]] const Answer& answer() const noexcept { return answer_; }
  // The link that was late when the lookup was parked last, if one was.
  [[nodiscard]] const LateLink& waited_for() const noexcept { return waited_for_; }

 protected:
  // Called once after the waiter was parked, unless it is cancelled: the lookup may now succeed, or
  // fail for good. Runs under the list's mutex, so it must not block, nor call the list.
  virtual void notify() noexcept = 0;

 private:
  friend class WaitList;
  friend bool lookup_or_park(const TreeState&, Waiter&, std::size_t);
  using ByTime = std::multimap<Stamp, Waiter*>;
  using ByName = std::unordered_multimap<std::string_view, Waiter*>;
  // Why a lookup waits for commits to a frame: it lacks a sample there, or it fails elsewhere and
  // passes this frame's link on its path.
  enum class Role : std::uint8_t { lacks_sample, on_path };
  struct ParkedOnFrame {
    FrameId frame;
    Role role;
    ByTime::iterator entry;
  };

  Query query_;
  const std::string_view target_, source_, fixed_;
  Answer answer_;
  LateLink waited_for_;

  // Guarded by the list's mutex.
  bool parked_ = false;
  bool is_woken_ = false;                 // in a list of waiters to be woken
  std::vector<ParkedOnFrame> on_frames_;  // each frame once for each part (WaitList::park())
  std::vector<ByName::iterator> on_names_;
  Waiter* next_woken_ = nullptr;
};

class WaitList {
 public:
  // Requires that the frames and their events outlive the list.
  WaitList(const Options& options, const Frame* frames, const FrameEvents* events)
      : options_(options), records_(frames), events_(events), waiters_(options.max_ids() + 1) {}

  // What a lookup rests on at one time. A `full` lookup at two times has two parts, and fails for
  // good as soon as one of them does, whichever it lacks now.
  struct Part {
    const ReadSet& reads;
    Stamp time;       // kNoStamp: the newest links do not connect the frames
    bool any_sample;  // any sample may help, as it may move the latest common time
  };
  // Parks the waiter under the frames of all parts, and under the names that it misses: step W1.
  // Throws bad_alloc, and Rejected if all waiters together would be parked on more than `max_links`
  // frames; then the waiter is not parked.
  void park(Waiter& waiter, std::span<const Part> parts, std::size_t max_links);
  // Returns whether the waiter was still parked. If so, notify() will not be called any more.
  bool cancel(Waiter& waiter);

  [[nodiscard]] std::size_t size() const noexcept { return size_.load(std::memory_order_seq_cst); }

  // Whether a lookup waits for the frame. Requires that the commit which changed it is counted.
  [[nodiscard]] bool has_waiters(FrameId frame) const noexcept {
    return waiters_[frame].load(std::memory_order_seq_cst) != 0;
  }

  // What a commit did to a frame.
  enum class Change : std::uint8_t {
    appended,  // only added samples newer than all before, under the same parent
    other,
  };
  // Wake the lookups that may now succeed, or fail for good, after a commit on this frame or of
  // this new name. Require that the commit is counted. Allocate nothing, as a commit that is done
  // must not fail.
  void notify_frame(FrameId frame, Change change) noexcept;
  void notify_name(std::string_view name) noexcept;
  // Wakes all lookups that wait for one of these frames, after any commit on them.
  void notify_frames(const FrameList& changed) noexcept {
    if (size() == 0) return;
    for (const FrameId frame : changed)
      if (has_waiters(frame)) notify_frame(frame, Change::other);
  }

 private:
  // The waiters parked under one frame, by the time that they ask about.
  struct FrameWaiters {
    Waiter::ByTime lacking_sample;  // kNoStamp: any newer sample may help
    Waiter::ByTime passing;

    Waiter::ByTime& of(Waiter::Role role) noexcept {
      return role == Waiter::Role::lacks_sample ? lacking_sample : passing;
    }
  };
  // Waiters to be woken, linked through the waiters, so that collecting them cannot fail.
  class WokenList;
  using Frames = std::unordered_map<FrameId, FrameWaiters>;

  void park_on_all(Waiter& waiter, std::span<const Part> parts, std::size_t max_links);
  void park_on_frame(Waiter& waiter, FrameId frame, const Part& part);
  void park_on_name(Waiter& waiter, FrameId id, std::string_view name);
  void unpark(Waiter& waiter) noexcept;
  void erase_if_empty(Frames::iterator frame) noexcept;
  void wake(const WokenList& woken) noexcept;

  const Options& options_;
  const Frame* const records_;
  const FrameEvents* const events_;
  std::atomic<std::size_t> size_{0};                       // parked waiters
  const ZeroedArray<std::atomic<std::uint32_t>> waiters_;  // by frame
  std::mutex mutex_;                                       // guards what follows
  std::size_t links_ = 0;  // frames that waiters are parked on, counted for each waiter
  Frames frames_;
  Waiter::ByName names_;
};

}  // namespace ztf
