// The folder `names/`: which id a name has, and which name an id has.
// In: names. Out: ids, and the texts of ids.
// It may include base, records.
//
// A hash table from names to dense ids, with open addressing. Ids of removed names are used again.
// A name is live, removed or freed (tree_state.hpp has the table of these states).
//
// Thread safety: what names/reader.hpp has, from any thread, without locks. The rest from one
// thread at a time (the tree's topology mutex).
// Invariants: names/reader.hpp's, and: texts are reused by size, tables double; so both are bounded
// by the most names that there ever were at a time.
#pragma once

#include <array>
#include <vector>

#include "base/yield_point.hpp"
#include "names/reader.hpp"
#include "records/region.hpp"

namespace ztf {

class NameTable : private NameReader<> {
 public:
  using Id = NameId;
  using Ref = NameRef;

  // Requires a root and entries that are zeroed, the entries for max_names + 1 ids, and that both
  // and the region outlive this object. Throws bad_alloc.
  NameTable(NameRoot& root, NameEntry* entries, std::uint32_t max_names, Region& region)
      : NameReader(prepared(root, entries), max_names),
        owned_root_(root),
        names_(entries),
        region_(region) {
    publish(make_slots(6));
  }
  NameTable(const NameTable&) = delete;
  NameTable& operator=(const NameTable&) = delete;

  using NameReader::find;
  using NameReader::find_any;
  using NameReader::find_each;
  using NameReader::find_ref;
  using NameReader::is_current;
  using NameReader::max_size;
  using NameReader::removed;
  using NameReader::size;

  // Returns the name that an id has, or had last if it was removed. Throws bad_alloc.
  [[nodiscard]] std::string name(Id id) const {
    std::string text;
    (void)read_name(id, text);  // trusted memory can be read
    return text;
  }

  // Removes a name, which keeps its id, or makes it live again. Both require the mutex. Both do
  // nothing to a name that is removed, or live, already, and remove() nothing to an id without one.
  void remove(Id id) noexcept {
    if (removed(id)) return;
    set_state(id, names_[id].state & ~NameEntry::kLive);
    ++removed_;
  }
  void restore(Id id) noexcept {
    if (!removed(id)) return;
    set_state(id, names_[id].state | NameEntry::kLive);
    --removed_;
  }
  // Makes all Refs of an id without a live name lose their validity, before the id passes to
  // another name. Requires the mutex.
  void expire_refs(Id id) noexcept { set_state(id, names_[id].state + NameEntry::kIncrement); }
  // How many names are live. Requires the mutex.
  [[nodiscard]] std::size_t live_names() const noexcept {
    return size() - free_ids_.size() - removed_;
  }
  // How many names are removed. Requires the mutex.
  [[nodiscard]] std::size_t removed_names() const noexcept { return removed_; }

  // How many slots the table has, and how many of them are not empty. Both require the mutex.
  [[nodiscard]] std::size_t slots() const noexcept { return slots_.size(); }
  [[nodiscard]] std::size_t used_slots() const noexcept { return used_slots_; }
  // How many ids are not in use. Requires the mutex.
  [[nodiscard]] std::size_t left() const noexcept { return max_size() - size() + free_ids_.size(); }
  // The id that insert() returns after `inserts` more calls of it. Requires the mutex, and that
  // left() is greater than `inserts`.
  [[nodiscard]] Id next_id(std::size_t inserts = 0) const noexcept {
    if (inserts < free_ids_.size()) return free_ids_[free_ids_.size() - 1 - inserts];
    return static_cast<Id>(size() + 1 + (inserts - free_ids_.size()));
  }

  // Makes room for that many names of that many bytes in all, so that inserting them cannot fail;
  // for names of frames also in the frames' records. Throws bad_alloc and Rejected.
  void reserve(std::size_t names, std::size_t bytes) {
    if (names_ == region_.names())
      region_.allocate_records(static_cast<Id>(std::min<std::size_t>(size() + names, max_size())));
    while ((size() + names) * 2 > slots() || (used_slots_ + names) * 4 > slots() * 3) grow();
    const std::size_t words = (2 * bytes + 7) / 8 + names * kLeastWords;  // rounded up each
    if (words > free_.size()) {
      const std::size_t least = words * sizeof(NameWord);
      const Region::Piece piece = region_.allocate(least, std::max<std::size_t>(least, 4096));
      free_ = {reinterpret_cast<NameWord*>(piece.begin), piece.bytes / sizeof(NameWord)};
    }
  }

  // Adds a name and returns its id. Requires a new name, and that left() is not 0. Throws
  // bad_alloc, unless reserve() has made room.
  Id insert(std::string_view name) { return insert(name, NameEntry::kLive); }
  // The same, but the name is removed from the start: no find() returns it before restore().
  Id insert_removed(std::string_view name) {
    const Id id = insert(name, 0);
    ++removed_;
    return id;
  }
  // Frees a name, so that another may get its id. Requires a name that is in the table. Throws
  // bad_alloc, and then changes nothing.
  void free(Id id) {
    std::size_t i = hash_(name(id));
    free_ids_.push_back(id);
    remove(id);
    --removed_;
    while (static_cast<Id>(slot(slots_, i).load(std::memory_order_relaxed)) != id) ++i;
    slot(slots_, i).store(kTombstone, std::memory_order_release);
    if (slot(slots_, i + 1).load(std::memory_order_relaxed) != 0) return;
    for (; slot(slots_, i).load(std::memory_order_relaxed) == kTombstone; --i) {
      slot(slots_, i).store(0, std::memory_order_release);
      --used_slots_;
    }
  }
  // Frees all removed names. Throws bad_alloc; then some may still be removed.
  void free_removed() {
    const std::vector<bool> is_free = free_ids();
    for (Id id = 1; id <= size(); ++id)
      if (!is_free[id] && removed(id)) free(id);
  }

 private:
  using Slots = std::span<NameWord>;  // a power of two

  static const NameRoot& prepared(NameRoot& root, NameEntry* entries) {
    const NameHash hash;
    root.entries = distance(&root, entries);
    root.seeds[0] = hash.seed();
    root.seeds[1] = hash.mix();
    return root;
  }
  static std::uint64_t distance(const void* from, const void* to) noexcept {
    return reinterpret_cast<std::uintptr_t>(to) - reinterpret_cast<std::uintptr_t>(from);
  }
  static NameWord& slot(Slots slots, std::size_t i) noexcept {
    return slots[i & (slots.size() - 1)];
  }

  [[nodiscard]] Slots make_slots(unsigned logarithm) {
    const std::size_t bytes = sizeof(NameWord) << logarithm;
    return {reinterpret_cast<NameWord*>(region_.allocate(bytes, bytes).begin),
            std::size_t{1} << logarithm};
  }
  void publish(Slots slots) noexcept {
    slots_ = slots;
    const auto logarithm = static_cast<unsigned>(std::countr_zero(slots.size()));
    owned_root_.table.store(distance(&owned_root_, slots.data()) | logarithm,
                            std::memory_order_release);
  }
  void fill_slot(Slots slots, std::uint64_t hash, Id id) noexcept {
    std::size_t i = hash;
    std::uint64_t known;
    while ((known = slot(slots, i).load(std::memory_order_relaxed)) != 0 && known != kTombstone)
      ++i;
    used_slots_ += known == 0;
    slot(slots, i).store((hash >> 32 << 32) | id, std::memory_order_release);
  }
  void grow() {
    const Slots bigger = make_slots(static_cast<unsigned>(std::countr_zero(slots_.size())) + 1);
    const std::vector<bool> is_free = free_ids();
    used_slots_ = 0;  // of the bigger table
    for (Id id = 1; id <= size(); ++id)
      if (!is_free[id]) fill_slot(bigger, hash_(name(id)), id);
    publish(bigger);
  }

  // `live`: NameEntry::kLive, or 0 for a removed name.
  Id insert(std::string_view name, std::uint32_t live) {
    reserve(1, name.size());
    const Id id = next_id();
    if (!free_ids_.empty()) free_ids_.pop_back();
    set_text(names_[id], name, live);
    // Before the slot: whoever finds an id may rely on it to be within the size.
    if (id > size()) owned_root_.size.store(id, std::memory_order_release);
    fill_slot(slots_, hash_(name), id);
    yield_point();
    return id;
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
  void set_text(NameEntry& entry, std::string_view name, std::uint32_t live) noexcept {
    const auto relaxed = std::memory_order_relaxed, release = std::memory_order_release;
    const std::uint32_t state =
        entry.state.load(relaxed) & ~(NameEntry::kLive | NameEntry::kChanging);
    entry.state.store(state | NameEntry::kChanging, relaxed);
    const std::size_t old_length = entry.length.load(relaxed);
    NameWord* const old_text =
        const_cast<NameWord*>(entry.text(static_cast<std::uint32_t>(old_length)));
    NameWord* words = entry.words;
    if (name.size() > NameEntry::kShortBytes) {
      words = take_text(name.size());
      entry.words[0].store(distance(&entry, words), release);
    }
    for (std::size_t i = 0; i < name.size() / 8; ++i)
      words[i].store(word_at<std::uint64_t>(name.data() + 8 * i), release);
    if (name.size() % 8 != 0) words[name.size() / 8].store(last_word(name), release);
    entry.length.store(static_cast<std::uint32_t>(name.size()), release);
    if (old_length > NameEntry::kShortBytes) give_back_text(old_text, old_length);
    entry.state.store((state + NameEntry::kIncrement) | live, release);
  }

  // Texts of long names have a power of two of words, and a list of the free ones of each size. The
  // first word of a free one is the distance to the next, or 0.
  static constexpr std::size_t kLeastWords = 4;
  static std::size_t size_class(std::size_t bytes) noexcept {
    return static_cast<std::size_t>(std::bit_width((bytes + 7) / 8 - 1));
  }
  NameWord* take_text(std::size_t bytes) noexcept {
    NameWord*& free_text = free_texts_[size_class(bytes)];
    if (NameWord* const text = free_text) {
      const std::uint64_t to_next = text->load(std::memory_order_relaxed);
      free_text =
          to_next == 0
              ? nullptr
              : reinterpret_cast<NameWord*>(reinterpret_cast<std::uintptr_t>(text) + to_next);
      return text;
    }
    const std::size_t words = std::size_t{1} << size_class(bytes);
    NameWord* const text = free_.data();
    free_ = free_.subspan(words);
    return text;
  }
  void give_back_text(NameWord* text, std::size_t bytes) noexcept {
    NameWord*& free_text = free_texts_[size_class(bytes)];
    text->store(free_text ? distance(text, free_text) : 0, std::memory_order_release);
    free_text = text;
  }

  NameRoot& owned_root_;
  NameEntry* const names_;
  Region& region_;
  Slots slots_;
  std::vector<Id> free_ids_;
  std::size_t removed_ = 0;
  std::size_t used_slots_ = 0;              // of the last table: names and tombstones
  std::span<NameWord> free_;                // of the piece that texts are taken from
  std::array<NameWord*, 64> free_texts_{};  // by size class
};

}  // namespace ztf
