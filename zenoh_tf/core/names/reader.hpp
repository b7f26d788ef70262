// Finding names in a table of names, and the texts of ids (names/table.hpp).
//
// Thread safety: every function, from any thread, without locks, while a NameTable changes the
// table.
// Invariants
// 1. Ids count up from 1 without gaps; 0 means that there is no such name.
// 2. An entry's state is a sequence lock: it is kChanging while the text is replaced, and its other
//    bits count the names that the id has had, and calls of expire_refs(). A reader compares the
//    text between two loads of the state. If they are equal, the id had that name at both instants.
//    For longer reads, a NameRef says which of its names an id had, and is_current() whether it
//    still has that one.
// 3. A slot holds its id for as long as the name is in the table. Then it becomes a tombstone, and
//    may become empty only if the next slot is: so no search that has begun misses a name behind
//    it. If names come and go all the time, there are in the end as many tombstones as names. The
//    table grows before three quarters of its slots are in use, because a search for a name that
//    does not exist ends only at an empty one. At four slots a name they never are.
// 4. A hash table that was outgrown, and the text of a long name, stay valid memory until the end,
//    as a reader may still be in it.
// Short names are stored in their entries, because in a large tree each line touched is a miss.
#pragma once

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>

#include "names/hash.hpp"

namespace ztf {

static_assert(std::endian::native == std::endian::little, "names are compared as words");

using NameId = std::uint32_t;
using NameWord = std::atomic<std::uint64_t>;

// An id, and a counter that says which of its names was looked up. No other name ever has an equal
// NameRef, but for one 2^29 names later.
struct NameRef {
  NameId id = 0;  // 0: there is no such name
  std::uint32_t generation = 0;
  bool operator==(const NameRef&) const = default;
};

// A name. The text is zero after its end, up to a whole word.
struct alignas(32) NameEntry {
  static constexpr std::size_t kShortBytes = 24;
  // Bits of the state; the others count the names.
  static constexpr std::uint32_t kLive = 1, kChanging = 2, kIncrement = 4;

  NameWord words[kShortBytes / 8];  // the text, or the distance from here to a longer one
  std::atomic<std::uint32_t> length;
  std::atomic<std::uint32_t> state;

  [[nodiscard]] ZTF_ALWAYS_INLINE const NameWord* text(std::uint32_t bytes) const noexcept {
    if (bytes <= kShortBytes) return words;
    return reinterpret_cast<const NameWord*>(reinterpret_cast<std::uintptr_t>(this) +
                                             words[0].load(std::memory_order_acquire));
  }
};

// Where a table's parts are, as distances (records/layout.hpp). A slot holds the hash's upper half
// and the id; 0 is empty. The hash's lower half chooses the first slot to probe.
struct alignas(64) NameRoot {
  std::atomic<std::uint64_t> table;
  std::atomic<std::uint32_t> size;  // the highest id ever used
  std::uint64_t entries;
  std::uint64_t seeds[2];  // of the hash
};

// Trusts what it reads.
struct TrustedMemory {
  // Whether a record that is read from a shared word may be followed.
  static constexpr bool holds(const void*, std::size_t) noexcept { return true; }
  // How often a text is read again that changes meanwhile.
  static constexpr bool may_retry(int) noexcept { return true; }
  static constexpr std::size_t longest_name() noexcept { return static_cast<std::size_t>(-1); }
};

template <class Memory = TrustedMemory>
class NameReader {
 public:
  NameReader(const NameRoot& root, std::uint32_t max_names, const Memory& memory = Memory())
      : root_(root),
        entries_(at<NameEntry>(root.entries)),
        hash_(root.seeds[0], root.seeds[1]),
        max_names_(max_names),
        memory_(memory) {}

  // Returns the name's id; 0 if there is no such live name.
  [[nodiscard]] NameId find(std::string_view name) const noexcept { return find_ref(name).id; }
  [[nodiscard]] NameRef find_ref(std::string_view name) const noexcept {
    return find<NameEntry::kLive>(table(), hash_(name), name);
  }
  // The same, live or removed. Requires the mutex of the table.
  [[nodiscard]] NameId find_any(std::string_view name) const noexcept {
    return find<0>(table(), hash_(name), name).id;
  }
  // Returns whether the id has had the name of this NameRef all the time since it was found, live
  // or removed. One without an id is always current. If the caller has acquired anything that was
  // stored after another name got the id, it is not: the insertion is sequenced before that store.
  // The load is a hit, as find_ref() has compared the name in the same cache line.
  [[nodiscard]] ZTF_ALWAYS_INLINE bool is_current(NameRef ref) const noexcept {
    return entries_[ref.id].state.load(std::memory_order_acquire) / NameEntry::kIncrement ==
           ref.generation;
  }

  // Does find() for each name. All slots are prefetched before the first is read, so that their
  // misses overlap (measured in commits/plan.cpp).
  void find_each(std::span<const std::string_view> names, NameId* ids) const noexcept {
    constexpr std::size_t kTogether = 32;
    const Table slots = table();
    std::uint64_t hashes[kTogether];
    while (!names.empty()) {
      const auto some = names.first(std::min(kTogether, names.size()));
      for (std::size_t i = 0; i < some.size(); ++i) {
        hashes[i] = hash_(some[i]);
        __builtin_prefetch(&slots.slot(hashes[i]));
      }
      for (std::size_t i = 0; i < some.size(); ++i)
        *ids++ = find<NameEntry::kLive>(slots, hashes[i], some[i]).id;
      names = names.subspan(some.size());
    }
  }

  // Sets the name that an id has, or had last if it was removed. Returns false if the memory does
  // not allow to read it. Throws bad_alloc.
  [[nodiscard]] bool read_name(NameId id, std::string& text) const {
    if (id > max_names_) return false;
    const NameEntry& entry = entries_[id];
    for (int retries = 0; memory_.may_retry(retries); ++retries) {
      const std::uint32_t state = entry.state.load(std::memory_order_acquire);
      const std::uint32_t length = entry.length.load(std::memory_order_acquire);
      const NameWord* const words = entry.text(length);
      if ((state & NameEntry::kChanging) || entry.state.load(std::memory_order_relaxed) != state)
        continue;
      const std::size_t bytes = (std::size_t{length} + 7) / 8 * 8;
      if (length > memory_.longest_name() || !memory_.holds(words, bytes)) continue;
      text.assign(bytes, '\0');
      for (std::size_t i = 0; i * 8 < length; ++i) {
        const std::uint64_t word = words[i].load(std::memory_order_acquire);
        std::memcpy(text.data() + i * 8, &word, 8);
      }
      text.resize(length);
      if (entry.state.load(std::memory_order_relaxed) == state) return true;
    }
    return false;
  }
  [[nodiscard]] bool removed(NameId id) const noexcept {
    return !(entries_[id].state.load(std::memory_order_acquire) & NameEntry::kLive);
  }
  [[nodiscard]] const NameEntry* entries() const noexcept { return entries_; }
  // The highest id ever used.
  [[nodiscard]] std::uint32_t size() const noexcept {
    return std::min(root_.size.load(std::memory_order_acquire), max_names_);
  }
  [[nodiscard]] std::uint32_t max_size() const noexcept { return max_names_; }

 protected:
  struct Table {
    const NameWord* slots;
    std::uint64_t mask;
    [[nodiscard]] const NameWord& slot(std::uint64_t i) const noexcept { return slots[i & mask]; }
  };
  static constexpr std::uint64_t kLogarithm = 63;
  static constexpr std::uint64_t kTombstone = std::uint64_t{1} << 32;  // its id is 0

  template <class T>
  const T* at(std::uint64_t distance) const noexcept {
    return reinterpret_cast<const T*>(reinterpret_cast<std::uintptr_t>(&root_) + distance);
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE Table table() const noexcept {
    const std::uint64_t word = root_.table.load(std::memory_order_acquire);
    const Table table{at<NameWord>(word & ~kLogarithm),
                      (std::uint64_t{1} << (word & kLogarithm)) - 1};
    // An empty table, if the word leads nowhere. More slots than 2^40 fit nowhere.
    if ((word & kLogarithm) > 40 ||
        !memory_.holds(table.slots, (table.mask + 1) * sizeof(NameWord)))
      return {entries_[0].words, 0};
    return table;
  }

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
  ZTF_ALWAYS_INLINE bool has_name(const NameEntry& entry, std::string_view name,
                                  std::uint32_t& state) const noexcept {
    state = entry.state.load(std::memory_order_acquire);
    if ((state & (wanted | NameEntry::kChanging)) != wanted) return false;
    if (entry.length.load(std::memory_order_acquire) != name.size()) return false;
    const NameWord* const words = entry.text(static_cast<std::uint32_t>(name.size()));
    // The distance and the length must belong together before the text is read.
    if (name.size() > NameEntry::kShortBytes &&
        (entry.state.load(std::memory_order_relaxed) != state ||
         !memory_.holds(words, (name.size() + 7) / 8 * 8)))
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
  ZTF_ALWAYS_INLINE NameRef find(const Table& table, std::uint64_t hash,
                                 std::string_view name) const noexcept {
    for (std::uint64_t i = hash, probes = 0; probes <= table.mask; ++probes, ++i) {
      const std::uint64_t slot = table.slot(i).load(std::memory_order_acquire);
      if (slot == 0) return {};
      if ((slot ^ hash) >> 32 == 0) {
        const NameId id = static_cast<NameId>(slot);
        std::uint32_t state;
        if (id != 0 && id <= max_names_ && has_name<wanted>(entries_[id], name, state))
          return {id, state / NameEntry::kIncrement};
      }
    }
    return {};
  }

  const NameRoot& root_;
  const NameEntry* const entries_;
  const NameHash hash_;
  const std::uint32_t max_names_;
  const Memory memory_;
};

}  // namespace ztf
