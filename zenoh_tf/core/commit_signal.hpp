// Counts commits, and wakes who waits for one.
//
// Thread safety: all of it.
// Why no commit is missed: a writer unlocks its frames, counts, then looks for
// waiters; a waiter announces itself, then looks at the count. Both steps are
// sequentially consistent, so at least one of the two sees the other. A waiter
// takes the count before it reads the tree, so a commit after that read counts.
// Writers that nobody waits for touch only a counter of their own thread.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace ztf {

class CommitSignal {
 public:
  using Clock = std::chrono::steady_clock;

  void announce() {
    shards_[shard()].count.fetch_add(1, std::memory_order_seq_cst);
    if (waiting_.load(std::memory_order_seq_cst) == 0) [[likely]]
      return;
    { const std::lock_guard lock(mutex_); }  // nobody is between its check and its sleep
    changed_.notify_all();
  }

  // Grows with every commit.
  [[nodiscard]] std::uint64_t epoch() const noexcept {
    std::uint64_t sum = 0;
    for (const Shard& shard : shards_) sum += shard.count.load(std::memory_order_seq_cst);
    return sum;
  }

  // Returns when epoch() is not `seen` any more, or at the deadline.
  void wait(std::uint64_t seen, Clock::time_point deadline) {
    waiting_.fetch_add(1, std::memory_order_seq_cst);
    {
      std::unique_lock lock(mutex_);
      changed_.wait_until(lock, deadline, [&] { return epoch() != seen; });
    }
    waiting_.fetch_sub(1, std::memory_order_relaxed);
  }

 private:
  static constexpr std::size_t kShards = 32;
  struct alignas(64) Shard {
    std::atomic<std::uint64_t> count{0};
  };
  static std::size_t shard() noexcept {
    static std::atomic<std::size_t> next{0};
    thread_local const std::size_t mine = next.fetch_add(1, std::memory_order_relaxed) % kShards;
    return mine;
  }

  Shard shards_[kShards];
  alignas(64) std::atomic<std::uint32_t> waiting_{0};
  std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace ztf
