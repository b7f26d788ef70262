// The layout of the memory that lookups touch: the one place that documents it.
//
// A tree whose memory is shared keeps all of this in one region, in this order. Other processes map
// the region read-only, each at an address of its own.
//
//   header       RegionHeader, one page
//   frames       Frame[max_ids + 1], by id (records/frame.hpp)
//   events       FrameEvents[max_ids + 1], by id (records/frame_info.hpp)
//   names        NameEntry[max_ids + 1], by id (names/reader.hpp)
//   authorities  NameEntry[max_authorities + 1], by id
//   arena        rings of samples, hash tables and long texts of names, up to RegionHeader::used
//
// There are as many ids as Options::max_ids() says of the header's max_frames.
//
// A tree of one process has the same records in private memory, in several pieces.
//
// No word that a reader follows is an address. Each is a distance in bytes, from the record named
// in its comment, modulo 2^64:
//   RelativeRing        from Frame::latest to the ring; low 6 bits: logarithm of its capacity
//   NameRoot::table     from the root to the slots; low 6 bits: logarithm of their number
//   NameRoot::entries   from the root to the entries
//   NameEntry::words    from the entry to its text, if that is longer than 24 bytes
// A process that reads another's memory must check each before it follows it
// (shared/mapped_memory.hpp). Free rings and texts are linked by distances, too, so that no reader
// learns an address of the owner.
//
// Thread safety: constant words are written before the region is handed out. All others are
// atomics, each written as its comment says.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <initializer_list>

#include "names/reader.hpp"
#include "records/frame_info.hpp"
#include "system/host.hpp"

namespace ztf {

constexpr std::size_t kHeaderBytes = 4096;

struct alignas(128) RegionHeader {
  // Constant.
  std::uint64_t magic;           // kMagic
  std::uint64_t layout_version;  // kLayoutVersion
  std::uint64_t layout_hash;     // kLayoutHash
  std::uint64_t bytes;           // to map: the most that the file may have; it grows
  char boot_id[40];              // of the host: a clock of another boot cannot be compared
  std::uint64_t time_namespace;  // its inode: CLOCK_MONOTONIC may differ between two; 0: unknown
  char instance[64];             // which server this is; ends with a zero byte
  std::uint64_t cache_ns;
  std::uint32_t concurrency;  // Concurrency
  std::uint32_t max_frames, max_authorities, max_samples_per_frame, max_name_bytes, max_depth;
  std::uint64_t frames, events;  // distances from the header

  // The end of the arena's used part, as a distance from the header. It only grows, after the file.
  alignas(64) std::atomic<std::uint64_t> used;
  // The time of CLOCK_MONOTONIC, in ns, up to which readers of other processes may trust what
  // they have read. The owner moves it ahead as long as it lives; 0 if it has not begun, or ended.
  alignas(64) std::atomic<std::int64_t> lease_ns;
  // The times of CLOCK_MONOTONIC, in ns, at which the server started, and up to which its
  // publishers may not be back yet; 0 in a tree that no server has.
  std::atomic<std::int64_t> started_ns, starting_until_ns;
  // What walks and names rest on.
  alignas(64) std::atomic<bool> ever_reparented;  // some frame once had samples of two parents
  // Counts how often ids of removed names or authorities were freed.
  std::atomic<std::uint64_t> ids_freed;
  NameRoot names, authorities;
};
static_assert(sizeof(RegionHeader) <= kHeaderBytes);

// How long ago a server started whose publishers may not be back yet, and for how long they may
// not.
struct Startup {
  std::int64_t elapsed_ns, left_ns;
  [[nodiscard]] bool is_over() const noexcept { return left_ns <= 0; }
};
[[nodiscard]] inline Startup startup_of(const RegionHeader& header) noexcept {
  const std::int64_t now_ns = coarse_monotonic_ns();
  return {now_ns - header.started_ns.load(std::memory_order_relaxed),
          header.starting_until_ns.load(std::memory_order_acquire) - now_ns};
}

constexpr std::uint64_t kMagic = 0x65657274'66747a01;  // 01 "ztftree", in memory order
// To be counted up with every change that the hash below does not see.
constexpr std::uint64_t kLayoutVersion = 3;

// Differs if a field is added, removed or resized, as that moves a field of the list or changes a
// size. So the list need not have all fields. It cannot see a change of meaning, two fields of one
// size that swap places, or one that padding absorbs. A region that is not what its hash says gives
// readers wrong values; it leads them nowhere outside, as they trust no word of it.
constexpr std::uint64_t hash_of_layout() noexcept {
  std::uint64_t hash = 0xcbf29ce484222325;  // FNV-1a
  for (const std::uint64_t fact : std::initializer_list<std::uint64_t>{
           kLayoutVersion,
           sizeof(RegionHeader),
           offsetof(RegionHeader, instance),
           offsetof(RegionHeader, frames),
           offsetof(RegionHeader, used),
           offsetof(RegionHeader, lease_ns),
           offsetof(RegionHeader, ever_reparented),
           offsetof(RegionHeader, ids_freed),
           offsetof(RegionHeader, names),
           offsetof(RegionHeader, authorities),
           sizeof(Frame),
           offsetof(Frame, parent),
           offsetof(Frame, ring),
           offsetof(Frame, first),
           offsetof(Frame, count),
           offsetof(Frame, oldest_stamp),
           offsetof(Frame, samples_per_ns),
           offsetof(Frame, parent_changes),
           offsetof(Frame, is_static),
           offsetof(Frame, authority),
           offsetof(Frame, evicted),
           offsetof(Frame, latest),
           sizeof(Sample),
           offsetof(Sample, pose),
           sizeof(FrameEvents),
           offsetof(FrameEvents, change_stamp),
           offsetof(FrameEvents, change),
           sizeof(NameRoot),
           offsetof(NameRoot, size),
           offsetof(NameRoot, entries),
           offsetof(NameRoot, seeds),
           sizeof(NameEntry),
           offsetof(NameEntry, length),
           offsetof(NameEntry, state),
       })
    hash = (hash ^ fact) * 0x100000001b3;
  return hash;
}
constexpr std::uint64_t kLayoutHash = hash_of_layout();

}  // namespace ztf
