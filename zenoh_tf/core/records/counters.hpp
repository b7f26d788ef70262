// Counters of commits: of all, and of each authority's.
//
// Thread safety: every function, from any thread. A counter is split into shards, of which a thread
// uses one, so that writers rarely share a cache line.
// Ordering: ShardedCounter is sequentially consistent. A commit unlocks its frames, then counts
// itself, so a thread that has seen the count sees the frames' new versions.
#pragma once

#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "system/zeroed_array.hpp"

namespace ztf {

using AuthorityId = std::uint32_t;  // 1, 2, ...; 0: none was named

// Returns the shard of the calling thread, out of a power of two. It is computed from the thread's
// address, because in a loaded module a thread-local number would cost a call. Thread stacks mostly
// lie at equal distances, which this multiplier spreads evenly.
template <std::size_t shards>
std::size_t shard_of_thread() noexcept {
  const auto self = reinterpret_cast<std::uintptr_t>(pthread_self());
  return std::uint64_t{self >> 12} * 0x9E3779B97F4A7C15u >> (64 - std::countr_zero(shards));
}

class ShardedCounter {
 public:
  void add() noexcept {
    shards_[shard_of_thread<kShards>()].count.fetch_add(1, std::memory_order_seq_cst);
  }

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

  Shard shards_[kShards];
};

// What one commit did: rows stored, rows dropped, samples replaced at their stamp, and frames taken
// over from another authority. A row is dropped if it is too old, or older than all samples of a
// full frame. `conflicts` has nothing to do with Code::conflict, a read set that has changed.
struct CommitTally {
  std::uint32_t stored = 0, dropped = 0, rewritten = 0, conflicts = 0;
  std::uint32_t commits = 1;  // 0: a put of which no row is stored
};

struct AuthorityCounts {
  // When the authority was last used, counted in new authorities.
  std::uint64_t last_used = 0;
  std::uint64_t commits = 0, stored = 0, dropped = 0, rewritten = 0, conflicts = 0;
};

// What each authority's commits did. Commits without an authority are not counted here.
class AuthorityCounters {
 public:
  explicit AuthorityCounters(std::uint32_t authorities)
      : shards_(std::size_t{authorities} * kShards) {}

  void add(AuthorityId id, const CommitTally& tally) noexcept {
    Shard& shard = shards_[std::size_t{id - 1} * kShards + shard_of_thread<kShards>()];
    const std::uint64_t now = now_.load(std::memory_order_relaxed);
    if (shard.last_used.load(std::memory_order_relaxed) != now)
      shard.last_used.store(now, std::memory_order_relaxed);
    const auto add = [](std::atomic<std::uint64_t>& counter, std::uint32_t n) {
      if (n != 0) counter.fetch_add(n, std::memory_order_relaxed);
    };
    add(shard.commits, tally.commits);
    add(shard.stored, tally.stored);
    add(shard.dropped, tally.dropped);
    add(shard.rewritten, tally.rewritten);
    add(shard.conflicts, tally.conflicts);
  }

  // Begins to count for a new authority, which may have the id of one that was freed.
  void start(AuthorityId id) noexcept {
    const std::uint64_t now = now_.fetch_add(1, std::memory_order_relaxed) + 1;
    for (std::size_t i = 0; i < kShards; ++i) {
      Shard& shard = shards_[std::size_t{id - 1} * kShards + i];
      for (auto* counter :
           {&shard.commits, &shard.stored, &shard.dropped, &shard.rewritten, &shard.conflicts})
        counter->store(0, std::memory_order_relaxed);
      shard.last_used.store(now, std::memory_order_relaxed);
    }
  }

  [[nodiscard]] AuthorityCounts sum(AuthorityId id) const noexcept {
    AuthorityCounts sum;
    for (std::size_t i = 0; i < kShards; ++i) {
      const Shard& shard = shards_[std::size_t{id - 1} * kShards + i];
      sum.last_used = std::max(sum.last_used, shard.last_used.load(std::memory_order_relaxed));
      sum.commits += shard.commits.load(std::memory_order_relaxed);
      sum.stored += shard.stored.load(std::memory_order_relaxed);
      sum.dropped += shard.dropped.load(std::memory_order_relaxed);
      sum.rewritten += shard.rewritten.load(std::memory_order_relaxed);
      sum.conflicts += shard.conflicts.load(std::memory_order_relaxed);
    }
    return sum;
  }

 private:
  static constexpr std::size_t kShards = 8;
  struct alignas(64) Shard {
    std::atomic<std::uint64_t> commits, stored, dropped, rewritten, conflicts, last_used;
  };

  const ZeroedArray<Shard> shards_;
  std::atomic<std::uint64_t> now_{0};  // counts new authorities
};

}  // namespace ztf
