// Keeps the lease of a shared tree as long as this process lives and runs.
//
// A thread of its own moves the lease's end, so no other work of the process delays it: neither
// commits nor Python, whose interpreter lock a long request may hold for longer than the lease.
//
// Thread safety: construction and destruction, by one thread at a time.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "tree_state.hpp"

namespace ztf {

class LeaseKeeper {
 public:
  // Readers of other processes trust the tree for so long after the last heartbeat.
  static constexpr std::chrono::milliseconds kDuration{250};
  static constexpr std::chrono::milliseconds kPeriod{50};

  // Begins the lease. Requires that no other process can take over while this one lives, even if
  // it is stopped for long: after a pause it begins a new lease. The tree must outlive the keeper.
  explicit LeaseKeeper(TreeState& tree) : tree_(tree) {
    tree_.begin_lease(kDurationNs);
    thread_ = std::thread([this] { run(); });
  }
  // Ends the lease.
  ~LeaseKeeper() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    stop_.notify_one();
    thread_.join();
    tree_.begin_lease(0);
  }
  LeaseKeeper(const LeaseKeeper&) = delete;
  LeaseKeeper& operator=(const LeaseKeeper&) = delete;

 private:
  static constexpr std::int64_t kDurationNs = std::chrono::nanoseconds(kDuration).count();

  void run() {
    std::unique_lock lock(mutex_);
    while (!stop_.wait_for(lock, kPeriod, [this] { return stopped_; }))
      tree_.begin_lease(kDurationNs);
  }

  TreeState& tree_;
  std::mutex mutex_;
  std::condition_variable stop_;
  bool stopped_ = false;
  std::thread thread_;
};

}  // namespace ztf
