// A hash table from names to dense ids, with open addressing. Ids of removed names are used again.
// A hidden name cannot be found, but keeps its id until it is removed.
//
// Thread safety: find(), name() and what is const and noexcept, from any thread, without locks. The
// rest from one thread at a time (the tree's topology mutex).
// Invariants
// 1. Ids count up from 1 without gaps; 0 means that there is no such name.
// 2. An entry's state is a sequence lock: it is kChanging while the text is replaced, and its other
//    bits count the names that the id has had, and calls of expire_refs(). A reader compares the
//    text between two loads of the state. If they are equal, the id had that name at both instants.
//    For longer reads, a Ref says which of its names an id had, and is_current() whether it still
//    has that one.
// 3. A slot holds its id for as long as the name is in the table. Then it becomes a tombstone, and
//    may become empty only if the next slot is: so no search that has begun misses a name behind
//    it. If names come and go all the time, there are in the end as many tombstones as names. The
//    table grows before three quarters of its slots are in use, because a search for a name that
//    does not exist ends only at an empty one. At four slots a name they never are.
// 4. A table that was outgrown, and the text of a long name, stay valid memory until the end, as a
//    reader may still be in it. Texts are reused by size, tables double; so both are bounded by the
//    most names that there ever were at a time.
// Short names are stored in their entries, because in a large tree each line touched is a miss.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "name_hash.hpp"
#include "zeroed_array.hpp"

namespace ztf {

static_assert(std::endian::native == std::endian::little, "names are compared as words");

class NameTable {
 public:
  using Id = std::uint32_t;

  // An id, and a counter that says which of its names was looked up. No other name ever has an
  // equal Ref, but for one 2^29 names later.
  struct Ref {
    Id id = 0;  // 0: there is no such name
    std::uint32_t generation = 0;
    bool operator==(const Ref&) const = default;
  };

  explicit NameTable(std::uint32_t max_names)
      : max_names_(max_names), names_(std::size_t{max_names} + 1) {
    tables_.push_back(std::make_unique<Table>(64));
    table_.store(tables_.back().get(), std::memory_order_release);
  }
  NameTable(const NameTable&) = delete;
  NameTable& operator=(const NameTable&) = delete;

  // Returns the name's id; 0 if there is no such name, or it is hidden.
  [[nodiscard]] Id find(std::string_view name) const noexcept { return find_ref(name).id; }
  [[nodiscard]] Ref find_ref(std::string_view name) const noexcept {
    return find<kLive>(*table_.load(std::memory_order_acquire), hash_(name), name);
  }
  // The same, hidden or not. Requires the mutex.
  [[nodiscard]] Id find_any(std::string_view name) const noexcept {
    return find<0>(*table_.load(std::memory_order_acquire), hash_(name), name).id;
  }
  // Returns whether the id has had the name of this Ref all the time since it was found, hidden or
  // not. A Ref without an id is always current. If the caller has acquired anything that was stored
  // after another name got the id, it is not: insert() is sequenced before that store. The load is
  // a hit, as find_ref() has compared the name in the same cache line.
  [[nodiscard]] ZTF_ALWAYS_INLINE bool is_current(Ref ref) const noexcept {
    return names_[ref.id].state.load(std::memory_order_acquire) / kIncrement == ref.generation;
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
      for (std::size_t i = 0; i < some.size(); ++i)
        *ids++ = find<kLive>(table, hashes[i], some[i]).id;
      names = names.subspan(some.size());
    }
  }

  // Returns the name that an id has, or had last if it was removed. Throws bad_alloc.
  [[nodiscard]] std::string name(Id id) const {
    const Entry& entry = names_[id];
    for (;;) {
      const std::uint32_t state = entry.state.load(std::memory_order_acquire);
      const std::uint32_t length = entry.length.load(std::memory_order_acquire);
      const std::atomic<std::uint64_t>* const words = entry.text(length);
      if ((state & kChanging) || entry.state.load(std::memory_order_relaxed) != state) continue;
      std::string text((length + 7) / 8 * 8, '\0');
      for (std::size_t i = 0; i * 8 < length; ++i) {
        const std::uint64_t word = words[i].load(std::memory_order_acquire);
        std::memcpy(text.data() + i * 8, &word, 8);
      }
      text.resize(length);
      if (entry.state.load(std::memory_order_relaxed) == state) return text;
    }
  }
  [[nodiscard]] bool hidden(Id id) const noexcept {
    return !(names_[id].state.load(std::memory_order_acquire) & kLive);
  }
  // Hides a name, or shows it again. Both require the mutex. Both do nothing to a name that is
  // hidden, or shown, already, and hide() does nothing to an id that has no name.
  void hide(Id id) noexcept {
    if (hidden(id)) return;
    set_state(id, names_[id].state & ~kLive);
    ++hidden_;
  }
  void show(Id id) noexcept {
    if (!hidden(id)) return;
    set_state(id, names_[id].state | kLive);
    --hidden_;
  }
  // Makes all Refs of an id without a name, or with a hidden one, lose their validity, before the
  // id passes to another name. Requires the mutex.
  void expire_refs(Id id) noexcept { set_state(id, names_[id].state + kIncrement); }
  // How many names are neither hidden nor removed. Requires the mutex.
  [[nodiscard]] std::size_t live_names() const noexcept {
    return size() - free_ids_.size() - hidden_;
  }
  // How many names are hidden. Requires the mutex.
  [[nodiscard]] std::size_t hidden_names() const noexcept { return hidden_; }

  // The highest id ever used.
  [[nodiscard]] std::uint32_t size() const noexcept {
    return size_.load(std::memory_order_acquire);
  }
  [[nodiscard]] std::uint32_t max_size() const noexcept { return max_names_; }
  // How many slots the table has, and how many of them are not empty. Both require the mutex.
  [[nodiscard]] std::size_t slots() const noexcept { return tables_.back()->mask + 1; }
  [[nodiscard]] std::size_t used_slots() const noexcept { return used_slots_; }
  // How many ids are not in use. Requires the mutex.
  [[nodiscard]] std::size_t left() const noexcept { return max_names_ - size() + free_ids_.size(); }
  // The id that insert() returns after `inserts` more calls of it. Requires the mutex, and that
  // left() is greater than `inserts`.
  [[nodiscard]] Id next_id(std::size_t inserts = 0) const noexcept {
    if (inserts < free_ids_.size()) return free_ids_[free_ids_.size() - 1 - inserts];
    return static_cast<Id>(size() + 1 + (inserts - free_ids_.size()));
  }

  // Makes room for that many names of that many bytes in all, so that inserting them cannot fail.
  // Throws bad_alloc.
  void reserve(std::size_t names, std::size_t bytes) {
    while ((size() + names) * 2 > slots() || (used_slots_ + names) * 4 > slots() * 3) grow();
    const std::size_t words = (2 * bytes + 7) / 8 + names * kLeastWords;  // rounded up each
    if (words > left_) {
      const std::size_t block = std::max<std::size_t>(words, 512);
      blocks_.emplace_back(block);
      free_ = blocks_.back().begin();
      left_ = block;
    }
  }

  // Adds a name and returns its id. Requires a new name, and that left() is not 0. Throws
  // bad_alloc, unless reserve() has made room.
  Id insert(std::string_view name) {
    reserve(1, name.size());
    const Id id = next_id();
    if (!free_ids_.empty()) free_ids_.pop_back();
    set_text(names_[id], name);
    fill_slot(*tables_.back(), hash_(name), id);
    if (id > size()) size_.store(id, std::memory_order_release);
    return id;
  }

  // Removes a name, so that another may get its id. Requires a name that is in the table. Throws
  // bad_alloc, and then changes nothing.
  void remove(Id id) {
    Table& table = *tables_.back();
    std::size_t i = hash_(name(id)) & table.mask;
    free_ids_.push_back(id);
    hide(id);
    --hidden_;
    while (static_cast<Id>(table.slots[i].load(std::memory_order_relaxed)) != id)
      i = (i + 1) & table.mask;
    table.slots[i].store(kTombstone, std::memory_order_release);
    if (table.slots[(i + 1) & table.mask].load(std::memory_order_relaxed) != 0) return;
    for (; table.slots[i].load(std::memory_order_relaxed) == kTombstone; i = (i - 1) & table.mask) {
      table.slots[i].store(0, std::memory_order_release);
      --used_slots_;
    }
  }
  // Removes all hidden names. Throws bad_alloc; then some may still be hidden.
  void remove_hidden() {
    const std::vector<bool> is_free = free_ids();
    for (Id id = 1; id <= size(); ++id)
      if (!is_free[id] && hidden(id)) remove(id);
  }

 private:
  using Word = std::atomic<std::uint64_t>;
  // Bits of an entry's state; the others count its names.
  static constexpr std::uint32_t kLive = 1, kChanging = 2, kIncrement = 4;
  static constexpr std::size_t kShortBytes = 24;

  // The text is zero after its end, up to a whole word.
  struct alignas(32) Entry {
    Word words[kShortBytes / 8];  // the text, or the address of a longer one
    std::atomic<std::uint32_t> length;
    std::atomic<std::uint32_t> state;

    [[nodiscard]] ZTF_ALWAYS_INLINE const Word* text(std::uint32_t length) const noexcept {
      if (length <= kShortBytes) return words;
      return reinterpret_cast<const Word*>(words[0].load(std::memory_order_acquire));
    }
  };
  // A slot holds the hash's upper half and the id; 0 is empty. The hash's lower half chooses the
  // first slot to probe.
  struct Table {
    explicit Table(std::size_t size) : mask(size - 1), slots(size) {}
    std::size_t mask;
    ZeroedArray<std::atomic<std::uint64_t>> slots;
  };
  static constexpr std::uint64_t kTombstone = std::uint64_t{1} << 32;  // its id is 0

  // Returns the last 1 to 7 bytes of a name as a word.
  ZTF_ALWAYS_INLINE static std::uint64_t last_word(std::string_view name) noexcept {
    const std::size_t length = name.size(), rest = length % 8;
    const char* const end = name.data() + length;
    if (length >= 8) return word_at<std::uint64_t>(end - 8) >> (64 - 8 * rest);
    if (length >= 4)
      return word_at<std::uint32_t>(name.data()) | std::uint64_t{word_at<std::uint32_t>(end - 4)}
                                                       << (8 * (length - 4));
    std::uint64_t word = 0;
    for (std::size_t i = 0; i < length; ++i)
      word |= std::uint64_t{static_cast<unsigned char>(name[i])} << (8 * i);
    return word;
  }
  // Returns whether an entry that has the state's bits `wanted` has this name, and sets its state.
  template <std::uint32_t wanted>
  ZTF_ALWAYS_INLINE static bool has_name(const Entry& entry, std::string_view name,
                                         std::uint32_t& state) noexcept {
    state = entry.state.load(std::memory_order_acquire);
    if ((state & (wanted | kChanging)) != wanted) return false;
    if (entry.length.load(std::memory_order_acquire) != name.size()) return false;
    const Word* const words = entry.text(static_cast<std::uint32_t>(name.size()));
    // The address and the length must belong together before the text is read.
    if (name.size() > kShortBytes && entry.state.load(std::memory_order_relaxed) != state)
      return false;
    std::size_t i = 0;
    for (; i < name.size() / 8; ++i)
      if (words[i].load(std::memory_order_acquire) != word_at<std::uint64_t>(name.data() + 8 * i))
        return false;
    if (name.size() % 8 != 0 && words[i].load(std::memory_order_acquire) != last_word(name))
      return false;
    return entry.state.load(std::memory_order_relaxed) == state;
  }

  template <std::uint32_t wanted>
  ZTF_ALWAYS_INLINE Ref find(const Table& table, std::uint64_t hash,
                             std::string_view name) const noexcept {
    std::size_t i = hash & table.mask;
    for (std::size_t probes = 0; probes <= table.mask; ++probes, i = (i + 1) & table.mask) {
      const std::uint64_t slot = table.slots[i].load(std::memory_order_acquire);
      if (slot == 0) return {};
      if ((slot ^ hash) >> 32 == 0) {
        const Id id = static_cast<Id>(slot);
        std::uint32_t state;
        if (id != 0 && has_name<wanted>(names_[id], name, state)) return {id, state / kIncrement};
      }
    }
    return {};
  }
  void fill_slot(Table& table, std::uint64_t hash, Id id) noexcept {
    std::size_t i = hash & table.mask;
    std::uint64_t slot;
    while ((slot = table.slots[i].load(std::memory_order_relaxed)) != 0 && slot != kTombstone)
      i = (i + 1) & table.mask;
    used_slots_ += slot == 0;
    table.slots[i].store((hash >> 32 << 32) | id, std::memory_order_release);
  }
  void grow() {
    auto bigger = std::make_unique<Table>((tables_.back()->mask + 1) * 2);
    const std::vector<bool> is_free = free_ids();
    used_slots_ = 0;  // of the bigger table
    for (Id id = 1; id <= size(); ++id)
      if (!is_free[id]) fill_slot(*bigger, hash_(name(id)), id);
    tables_.push_back(std::move(bigger));
    table_.store(tables_.back().get(), std::memory_order_release);
  }

  // Returns for each id up to size() whether it has no name.
  [[nodiscard]] std::vector<bool> free_ids() const {
    std::vector<bool> is_free(size() + 1);
    for (const Id id : free_ids_) is_free[id] = true;
    return is_free;
  }
  void set_state(Id id, std::uint32_t state) noexcept {
    names_[id].state.store(state, std::memory_order_release);
  }
  // Replaces the text. Requires that reserve() has made room.
  void set_text(Entry& entry, std::string_view name) noexcept {
    const auto relaxed = std::memory_order_relaxed, release = std::memory_order_release;
    const std::uint32_t state = entry.state.load(relaxed) & ~(kLive | kChanging);
    entry.state.store(state | kChanging, relaxed);
    const std::size_t old_length = entry.length.load(relaxed);
    Word* const old_text = const_cast<Word*>(entry.text(static_cast<std::uint32_t>(old_length)));
    Word* words = entry.words;
    if (name.size() > kShortBytes) {
      words = take_text(name.size());
      entry.words[0].store(reinterpret_cast<std::uint64_t>(words), release);
    }
    for (std::size_t i = 0; i < name.size() / 8; ++i)
      words[i].store(word_at<std::uint64_t>(name.data() + 8 * i), release);
    if (name.size() % 8 != 0) words[name.size() / 8].store(last_word(name), release);
    entry.length.store(static_cast<std::uint32_t>(name.size()), release);
    if (old_length > kShortBytes) give_back_text(old_text, old_length);
    entry.state.store((state + kIncrement) | kLive, release);
  }

  // Texts of long names have a power of two of words, and a list of the free ones of each size.
  static constexpr std::size_t kLeastWords = 4;
  static std::size_t size_class(std::size_t bytes) noexcept {
    return static_cast<std::size_t>(std::bit_width((bytes + 7) / 8 - 1));
  }
  Word* take_text(std::size_t bytes) noexcept {
    Word*& free_text = free_texts_[size_class(bytes)];
    if (Word* const text = free_text) {
      free_text = reinterpret_cast<Word*>(text->load(std::memory_order_relaxed));
      return text;
    }
    Word* const text = free_;
    free_ += std::size_t{1} << size_class(bytes);
    left_ -= std::size_t{1} << size_class(bytes);
    return text;
  }
  void give_back_text(Word* text, std::size_t bytes) noexcept {
    Word*& free_text = free_texts_[size_class(bytes)];
    text->store(reinterpret_cast<std::uint64_t>(free_text), std::memory_order_release);
    free_text = text;
  }

  const NameHash hash_;
  const std::uint32_t max_names_;
  const ZeroedArray<Entry> names_;
  std::atomic<std::uint32_t> size_{0};
  std::atomic<const Table*> table_{nullptr};
  std::vector<std::unique_ptr<Table>> tables_;
  std::vector<Id> free_ids_;
  std::size_t hidden_ = 0;
  std::size_t used_slots_ = 0;  // of the last table: names and tombstones
  std::vector<ZeroedArray<Word>> blocks_;
  Word* free_ = nullptr;
  std::size_t left_ = 0;
  std::array<Word*, 64> free_texts_{};  // by size class
};

}  // namespace ztf
