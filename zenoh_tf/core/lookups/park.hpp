// Lookups that wait: each runs, and is parked if a later commit may let it succeed. Commits wake
// them (CommitExecution::notify_waiters, in commits/apply.hpp), as do removals and replays.
//
// waiting/wait_list.hpp has the argument that no wake-up is lost.
//
// Thread safety: every function, from any thread. Lock order: see tree_state.hpp.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>

#include "tree_state.hpp"

namespace ztf {

// Runs the lookup. Returns true if it is done: it succeeded, or failed for good. Returns false if
// the waiter is parked: notify() will be called once, when a commit may have changed the result.
// Throws bad_alloc, and Rejected if all waiters together would be parked on more than `max_links`
// frames; then the waiter is not parked.
bool lookup_or_park(const TreeState& tree, Waiter& waiter, std::size_t max_links = kNoReadLimit);

// A waiter that a thread blocks on.
class BlockingWaiter final : public Waiter {
 public:
  using Clock = std::chrono::steady_clock;

  BlockingWaiter(const TreeState& tree, const Query& query, std::string_view target,
                 std::string_view source, std::string_view fixed = {})
      : Waiter(query, target, source, fixed), tree_(tree) {}
  ~BlockingWaiter() override { tree_.wait_list.cancel(*this); }

  // Blocks until the lookup is done (lookup_or_park()), and returns true, or until the deadline,
  // and returns false. May be called again after the deadline.
  bool wait(Clock::time_point deadline) {
    for (;;) {
      if (!parked_here_) {
        if (lookup_or_park(tree_, *this)) return true;
        parked_here_ = true;
      }
      std::unique_lock lock(mutex_);
      if (!changed_.wait_until(lock, deadline, [&] { return woken_; })) return false;
      woken_ = parked_here_ = false;
    }
  }

 private:
  void notify() noexcept override {
    const std::lock_guard lock(mutex_);
    woken_ = true;
    changed_.notify_one();
  }

  const TreeState& tree_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool woken_ = false;        // guarded by mutex_
  bool parked_here_ = false;  // parked, and not yet seen to be woken; the blocking thread's own
};

}  // namespace ztf
