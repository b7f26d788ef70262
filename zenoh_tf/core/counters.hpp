// Counts commits: all, and what each authority's did.
//
// Thread safety: all of it. Threads count in different places, mostly, so that
// writers do not meet here.
// Ordering: ShardedCounter is sequentially consistent. A commit unlocks its frames,
// then counts; who has seen it counted sees its frames' new versions.
#pragma once

#include <pthread.h>

#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "zeroed_array.hpp"

namespace ztf {

using AuthorityId = std::uint32_t;  // 1, 2, ...; 0: none was named

// Which of so many places, a power of two, this thread counts in. From the thread's own address: a
// thread-local number would cost a call, for this is a loaded module. Stacks mostly lie at equal
// distances, which this multiplier spreads evenly.
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
    for (const LinkLookup& place : shards_) sum += place.count.load(std::memory_order_seq_cst);
    return sum;
  }

 private:
  static constexpr std::size_t kShards = 32;
  struct alignas(64) LinkLookup {
    std::atomic<std::uint64_t> count{0};
  };

  LinkLookup shards_[kShards];
};

// What one commit did to its rows.
struct CommitTally {
  std::uint32_t stored = 0, dropped = 0, rewritten = 0, conflicts = 0;
};

struct AuthorityCounts {
  std::uint64_t commits = 0, stored = 0, dropped = 0, rewritten = 0, conflicts = 0;
};

// Of the authorities with a name.
class AuthorityCounters {
 public:
  explicit AuthorityCounters(std::uint32_t authorities)
      : shards_(std::size_t{authorities} * kShards) {}

  void add(AuthorityId id, const CommitTally& tally, bool one_row) noexcept {
    LinkLookup& place = shards_[std::size_t{id - 1} * kShards + shard_of_thread<kShards>()];
    const auto add = [](std::atomic<std::uint64_t>& counter, std::uint32_t n) {
      if (n != 0) counter.fetch_add(n, std::memory_order_relaxed);
    };
    const bool single = one_row && tally.stored == 1;
    add(single ? place.single_commits : place.other_commits, 1);
    if (!single) add(place.stored_by_others, tally.stored);
    add(place.dropped, tally.dropped);
    add(place.rewritten, tally.rewritten);
    add(place.conflicts, tally.conflicts);
  }

  [[nodiscard]] AuthorityCounts sum(AuthorityId id) const noexcept {
    AuthorityCounts sum;
    for (std::size_t i = 0; i < kShards; ++i) {
      const LinkLookup& place = shards_[std::size_t{id - 1} * kShards + i];
      const std::uint64_t single = place.single_commits.load(std::memory_order_relaxed);
      sum.commits += single + place.other_commits.load(std::memory_order_relaxed);
      sum.stored += single + place.stored_by_others.load(std::memory_order_relaxed);
      sum.dropped += place.dropped.load(std::memory_order_relaxed);
      sum.rewritten += place.rewritten.load(std::memory_order_relaxed);
      sum.conflicts += place.conflicts.load(std::memory_order_relaxed);
    }
    return sum;
  }

 private:
  static constexpr std::size_t kShards = 8;
  struct alignas(64) LinkLookup {
    // The usual commit stores one row and counts one word.
    std::atomic<std::uint64_t> single_commits, other_commits, stored_by_others;
    std::atomic<std::uint64_t> dropped, rewritten, conflicts;
  };

  const ZeroedArray<LinkLookup> shards_;
};

}  // namespace ztf
