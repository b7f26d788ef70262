// Counts commits.
//
// Thread safety: all of it. Each thread counts in a place of its own, so that
// writers do not meet here.
// Ordering: add() and sum() are sequentially consistent. A commit unlocks its
// frames, then counts; who has seen it counted sees its frames' new versions.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace ztf {

class CommitCount {
 public:
  void add() noexcept { shards_[shard()].count.fetch_add(1, std::memory_order_seq_cst); }

  [[nodiscard]] std::uint64_t sum() const noexcept {
    std::uint64_t sum = 0;
    for (const Shard& shard : shards_) sum += shard.count.load(std::memory_order_seq_cst);
    return sum;
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
};

}  // namespace ztf
