// Counts commits.
//
// Thread safety: all of it. Threads count in different places, mostly, so that
// writers do not meet here.
// Ordering: add() and sum() are sequentially consistent. A commit unlocks its
// frames, then counts; who has seen it counted sees its frames' new versions.
#pragma once

#include <pthread.h>

#include <atomic>
#include <bit>
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
  // From the thread's own address: a thread-local number would cost a call, for this is a loaded
  // module. Stacks mostly lie at equal distances, which this multiplier spreads evenly.
  static std::size_t shard() noexcept {
    const auto self = reinterpret_cast<std::uintptr_t>(pthread_self());
    return std::uint64_t{self >> 12} * 0x9E3779B97F4A7C15u >> (64 - std::countr_zero(kShards));
  }

  Shard shards_[kShards];
};

}  // namespace ztf
