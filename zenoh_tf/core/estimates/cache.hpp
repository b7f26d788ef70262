// Backtests of questions that were asked before.
//
// A question is known by its path, the buckets of its lags, and the span of history that its level
// needs. Its backtest serves until the history of all links has grown by a step of the grid
// (estimates/cases.hpp), or was changed otherwise than by newer samples.
//
// Thread safety: every function, from any thread. The mutex is held for a search among a few
// hundred entries at most, and its holder takes no other lock.
#pragma once

#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "estimates/estimate.hpp"

namespace ztf {

struct Backtest;
struct PathNow;

class EstimateCache {
 public:
  using Key = SmallVector<std::uint32_t, 40>;
  using Entry = std::shared_ptr<const Backtest>;

  static void make_key(const PathNow& path, double level, Key& key);

  // Returns the question's backtest; `is_current` is whether it is of that state: else it is of an
  // earlier one, or null.
  Entry find(const Key& key, Stamp grid, std::uint64_t edits, bool& is_current);
  // Keeps a backtest, and drops those that were not used for longest if there are too many.
  void insert(const Key& key, Stamp grid, std::uint64_t edits, Entry entry);

  [[nodiscard]] std::size_t size() const {
    const std::lock_guard lock(mutex_);
    return entries_.size();
  }

  static constexpr std::size_t kMostEntries = 256, kMostBytes = std::size_t{4} << 20;

 private:
  struct Kept {
    std::vector<std::uint32_t> key;
    Stamp grid;
    std::uint64_t edits, used;
    Entry entry;
    [[nodiscard]] std::size_t bytes() const noexcept;
  };
  // Returns the entry of a key, or null. Requires the mutex.
  Kept* search(std::uint64_t hash, const Key& key) noexcept;

  mutable std::mutex mutex_;
  std::unordered_multimap<std::uint64_t, Kept> entries_;  // by the key's hash
  std::size_t bytes_ = 0;
  std::uint64_t uses_ = 0;
};

}  // namespace ztf
