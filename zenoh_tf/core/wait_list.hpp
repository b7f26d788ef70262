// Lookups that wait for a commit, and which commit wakes which of them.
//
// A lookup that failed, but may succeed later, is parked on the lists of the
// frames that its failure rests on, or of the names that it misses. A commit
// wakes those on its frames' lists whose answer it may have changed; who is
// woken asks again. Writers whose frames nobody waits for pay one load each.
//
// Thread safety: everything from any thread; a waiter belongs to one thread at
// a time. lookup_or_park() takes it over, and gives it away where it parks it; cancel()
// that returns true, or notify(), gives it back.
// Lock order: the list's mutex comes last; notify() is called under it.
// Why no commit is missed: lookup_or_park() fails on frames in certain versions, marks
// those frames as waited for, then counts the commits, then compares the
// versions. A commit unlocks its frames, is counted, then looks for the marks.
// All four are sequentially consistent, so where the commit does not see the
// mark, lookup_or_park() has seen it counted, and with it the new version. Where it sees
// the mark it takes the list's mutex, under which the parking was completed.
#pragma once

#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "guards.hpp"
#include "query.hpp"

namespace ztf {

class Tree;

// One waiting lookup.
class Waiter {
 public:
  // Names must outlive the waiter; the query's ids are found by them.
  Waiter(const Query& query, std::string_view target, std::string_view source,
         std::string_view fixed = {})
      : query_(query), target_(target), source_(source), fixed_(fixed) {}
  virtual ~Waiter() = default;
  Waiter(const Waiter&) = delete;
  Waiter& operator=(const Waiter&) = delete;

  // Of the last lookup_or_park().
  [[nodiscard]] const Query& query() const noexcept { return query_; }
  [[nodiscard]] const Answer& answer() const noexcept { return answer_; }

 protected:
  virtual void notify() noexcept = 0;  // must not block, nor call the list

 private:
  friend class WaitList;
  using List = std::multimap<Stamp, Waiter*>;
  using Names = std::unordered_multimap<std::string_view, Waiter*>;
  struct OnFrame {
    FrameId frame;
    bool blocked;
    List::iterator place;
  };

  Query query_;
  const std::string_view target_, source_, fixed_;
  Answer answer_;
  bool parked_ = false;  // this and what follows: under the list's mutex
  std::vector<OnFrame> on_frames_;
  std::vector<Names::iterator> on_names_;
};

class WaitList {
 public:
  explicit WaitList(const Tree& tree) noexcept : tree_(tree) {}

  // True: it is over, with an answer or with a failure that no commit can cure.
  // False: the waiter is parked, and notify() comes, once, if a commit may help.
  bool lookup_or_park(Waiter& waiter);
  // Whether the waiter was still parked; notify() then does not come any more.
  bool cancel(Waiter& waiter);

  [[nodiscard]] std::size_t size() const noexcept { return size_.load(std::memory_order_seq_cst); }

  // For commits, once counted: what became of a frame that is waited for.
  enum class Change : std::uint8_t {
    appended,  // samples newer than all before, under the same parent
    other,
  };
  void notify_frame(FrameId frame, Change change);
  void notify_name(std::string_view name);

 private:
  struct Lists {
    Waiter::List blocked;  // who waits for a sample of the frame, by its time; kNoStamp: for any
    Waiter::List passing;  // whose way leads over the frame at that time
  };

  void park(Waiter& waiter, const ReadSet& reads);
  void unpark(Waiter& waiter) noexcept;
  void wake(const std::vector<Waiter*>& waiters) noexcept;

  const Tree& tree_;
  std::atomic<std::size_t> size_{0};
  std::mutex mutex_;
  std::unordered_map<FrameId, Lists> frames_;
  Waiter::Names names_;
};

// One that a thread sleeps for.
class BlockingWaiter final : public Waiter {
 public:
  using Clock = std::chrono::steady_clock;

  BlockingWaiter(WaitList& list, const Query& query, std::string_view target,
                 std::string_view source, std::string_view fixed = {})
      : Waiter(query, target, source, fixed), list_(list) {}
  ~BlockingWaiter() override { list_.cancel(*this); }

  // True: it is over, as of lookup_or_park(). False at the deadline, after which it goes on.
  bool wait(Clock::time_point deadline) {
    for (;;) {
      if (!asleep_) {
        if (list_.lookup_or_park(*this)) return true;
        asleep_ = true;
      }
      std::unique_lock lock(mutex_);
      if (!changed_.wait_until(lock, deadline, [&] { return woken_; })) return false;
      woken_ = asleep_ = false;
    }
  }

 private:
  void notify() noexcept override {
    const std::lock_guard lock(mutex_);
    woken_ = true;
    changed_.notify_one();
  }

  WaitList& list_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool woken_ = false;
  bool asleep_ = false;  // the sleeping thread's own
};

}  // namespace ztf
