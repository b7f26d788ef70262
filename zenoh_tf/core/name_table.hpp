// A hash table from names to dense ids: open addressing, append-only.
//
// Thread safety: find() and name() from any thread, without locks. insert(), hide(), show() and
// reserve() from one thread at a time (the tree's topology mutex).
// Invariants
// 1. Ids count up from 1 without gaps; 0 means that there is no such name.
// 2. A filled slot never changes, but a name may be hidden and shown again.
// 3. A table that was outgrown is kept until the end, as a reader may still probe it. Tables
//    double, so all of them together are smaller than twice the last one.
// 4. insert() fills names_[id] before it publishes the slot with release order.
// Short names are stored in their entries, because in a large tree each line touched is a miss.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "name_hash.hpp"
#include "zeroed_array.hpp"

namespace ztf {

class NameTable {
 public:
  using Id = std::uint32_t;

  explicit NameTable(std::uint32_t max_names)
      : max_names_(max_names), names_(std::size_t{max_names} + 1) {
    tables_.push_back(std::make_unique<Table>(64));
    table_.store(tables_.back().get(), std::memory_order_release);
  }
  NameTable(const NameTable&) = delete;
  NameTable& operator=(const NameTable&) = delete;

  // Returns the name's id; 0 if there is no such name, or it is hidden.
  [[nodiscard]] Id find(std::string_view name) const noexcept {
    const Id id = find_any(name);
    return hidden(id) ? 0 : id;
  }
  // The same, hidden or not.
  [[nodiscard]] Id find_any(std::string_view name) const noexcept {
    return find_any(*table_.load(std::memory_order_acquire), hash_(name), name);
  }

  // Does find() for each name. All slots are prefetched before the first is read, so that their
  // misses overlap (measured in commit_plan.cpp).
  void find_each(std::span<const std::string_view> names, Id* ids) const noexcept {
    constexpr std::size_t kTogether = 32;
    const Table& table = *table_.load(std::memory_order_acquire);
    std::uint64_t hashes[kTogether];
    while (!names.empty()) {
      const auto some = names.first(std::min(kTogether, names.size()));
      for (std::size_t i = 0; i < some.size(); ++i) {
        hashes[i] = hash_(some[i]);
        __builtin_prefetch(&table.slots[hashes[i] & table.mask]);
      }
      for (std::size_t i = 0; i < some.size(); ++i) {
        const Id id = find_any(table, hashes[i], some[i]);
        *ids++ = hidden(id) ? 0 : id;
      }
      names = names.subspan(some.size());
    }
  }

  // Returns the name of an id. Requires an id that this thread has got from find() or size().
  [[nodiscard]] std::string_view name(Id id) const noexcept {
    const Entry& entry = names_[id];
    return {entry.length <= sizeof entry.text ? entry.text : entry.long_text, entry.length};
  }
  [[nodiscard]] bool hidden(Id id) const noexcept {
    return names_[id].hidden.load(std::memory_order_acquire);
  }
  void hide(Id id) noexcept { names_[id].hidden.store(true, std::memory_order_release); }
  void show(Id id) noexcept { names_[id].hidden.store(false, std::memory_order_release); }

  [[nodiscard]] std::uint32_t size() const noexcept {
    return size_.load(std::memory_order_acquire);
  }
  [[nodiscard]] std::uint32_t max_size() const noexcept { return max_names_; }

  // Makes room for that many names of that many bytes in all, so that inserting them cannot fail.
  // Throws bad_alloc.
  void reserve(std::size_t names, std::size_t bytes) {
    while ((size() + names) * 2 > tables_.back()->mask + 1) grow();
    if (bytes > left_) {
      const std::size_t block = std::max<std::size_t>(bytes, 4096);
      blocks_.push_back(std::make_unique<char[]>(block));
      free_ = blocks_.back().get();
      left_ = block;
    }
  }

  // Adds a name and returns its id. Requires a new name, and size() < max_size(). Throws bad_alloc,
  // unless reserve() has made room.
  Id insert(std::string_view name) {
    reserve(1, name.size());
    const Id id = size() + 1;
    Entry& entry = names_[id];
    entry.length = static_cast<std::uint32_t>(name.size());
    if (name.size() > sizeof entry.text)
      entry.long_text = copy(name);
    else
      std::ranges::copy(name, entry.text);
    fill_slot(*tables_.back(), hash_(name), id);
    size_.store(id, std::memory_order_release);
    return id;
  }

 private:
  struct alignas(32) Entry {
    union {
      char text[24];
      const char* long_text;
    };
    std::uint32_t length;
    std::atomic<bool> hidden;
  };
  // A slot holds the hash's upper half and the id; 0 is empty. The hash's lower half chooses the
  // first slot to probe.
  struct Table {
    explicit Table(std::size_t size) : mask(size - 1), slots(size) {}
    std::size_t mask;
    ZeroedArray<std::atomic<std::uint64_t>> slots;
  };

  ZTF_ALWAYS_INLINE Id find_any(const Table& table, std::uint64_t hash,
                                std::string_view name) const noexcept {
    for (std::size_t i = hash & table.mask;; i = (i + 1) & table.mask) {
      const std::uint64_t slot = table.slots[i].load(std::memory_order_acquire);
      if (slot == 0) return 0;
      if ((slot ^ hash) >> 32 == 0) {
        const Id id = static_cast<Id>(slot);
        if (same_name(this->name(id), name)) return id;
      }
    }
  }
  static void fill_slot(Table& table, std::uint64_t hash, Id id) noexcept {
    std::size_t i = hash & table.mask;
    while (table.slots[i].load(std::memory_order_relaxed) != 0) i = (i + 1) & table.mask;
    table.slots[i].store((hash >> 32 << 32) | id, std::memory_order_release);
  }
  void grow() {
    auto bigger = std::make_unique<Table>((tables_.back()->mask + 1) * 2);
    for (Id id = 1; id <= size(); ++id) fill_slot(*bigger, hash_(name(id)), id);
    tables_.push_back(std::move(bigger));
    table_.store(tables_.back().get(), std::memory_order_release);
  }
  const char* copy(std::string_view name) noexcept {
    char* text = free_;
    std::memcpy(text, name.data(), name.size());
    free_ += name.size();
    left_ -= name.size();
    return text;
  }

  const NameHash hash_;
  const std::uint32_t max_names_;
  const ZeroedArray<Entry> names_;
  std::atomic<std::uint32_t> size_{0};
  std::atomic<const Table*> table_{nullptr};
  std::vector<std::unique_ptr<Table>> tables_;
  std::vector<std::unique_ptr<char[]>> blocks_;
  char* free_ = nullptr;
  std::size_t left_ = 0;
};

}  // namespace ztf
