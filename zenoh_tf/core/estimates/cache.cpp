// How backtests are kept.
#include "estimates/cache.hpp"

#include "estimates/backtest.hpp"

namespace ztf {

namespace {

std::uint64_t hash_of(const EstimateCache::Key& key) noexcept {
  std::uint64_t hash = 0x9e3779b97f4a7c15;
  for (const std::uint32_t word : key)
    hash = (hash ^ word) * 0xff51afd7ed558ccd, hash ^= hash >> 32;
  return hash;
}

}  // namespace

std::size_t EstimateCache::Kept::bytes() const noexcept {
  return 256 + key.size() * sizeof(std::uint32_t) + entry->bound.bytes();
}

void EstimateCache::make_key(const PathNow& path, double level, Key& key) {
  key.clear();
  key.push_back(window_class(level));
  key.push_back(path.ancestor);
  for (const LinkNow& link : path.links) {
    key.push_back(link.child);
    key.push_back(lag_bucket(link.lag) << 4 | static_cast<std::uint32_t>(link.kind) << 1 |
                  static_cast<std::uint32_t>(link.inverted));
  }
}

EstimateCache::Kept* EstimateCache::search(std::uint64_t hash, const Key& key) noexcept {
  const auto [begin, end] = entries_.equal_range(hash);
  for (auto at = begin; at != end; ++at)
    if (std::equal(key.begin(), key.end(), at->second.key.begin(), at->second.key.end()))
      return &at->second;
  return nullptr;
}

EstimateCache::Entry EstimateCache::find(const Key& key, Stamp grid, std::uint64_t edits,
                                         bool& is_current) {
  const std::uint64_t hash = hash_of(key);
  const std::lock_guard lock(mutex_);
  Kept* const kept = search(hash, key);
  is_current = kept && kept->grid == grid && kept->edits == edits;
  if (!kept) return nullptr;
  kept->used = ++uses_;
  return kept->entry;
}

void EstimateCache::insert(const Key& key, Stamp grid, std::uint64_t edits, Entry entry) {
  const std::uint64_t hash = hash_of(key);
  const std::lock_guard lock(mutex_);
  if (Kept* const kept = search(hash, key)) {
    bytes_ -= kept->bytes();
    *kept = {std::move(kept->key), grid, edits, ++uses_, std::move(entry)};
    bytes_ += kept->bytes();
  } else {
    Kept made{{key.begin(), key.end()}, grid, edits, ++uses_, std::move(entry)};
    bytes_ += entries_.emplace(hash, std::move(made))->second.bytes();
  }
  while (entries_.size() > kMostEntries || (bytes_ > kMostBytes && entries_.size() > 1)) {
    const auto oldest = std::min_element(
        entries_.begin(), entries_.end(),
        [](const auto& a, const auto& b) { return a.second.used < b.second.used; });
    bytes_ -= oldest->second.bytes();
    entries_.erase(oldest);
  }
}

}  // namespace ztf
