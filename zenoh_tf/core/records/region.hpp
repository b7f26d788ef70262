// The memory that lookups touch (records/layout.hpp): private, or a region that others can map
// read-only.
//
// The shared region is a memfd: a file without a name. It is mapped once at the greatest size that
// it may have, and the file grows in steps as the tree does. So a reader that touches every page
// takes no more of the host's memory than the arrays and the steps so far. The arrays are in the
// file from the start, with a page for each part that was touched, by the owner or by a reader.
//
// Readers get a descriptor that is only for reading: with it nobody can write, allocate (fallocate)
// or change the size. The file is sealed against shrinking and against further writable mappings. A
// process of the same user, or root, could still open it again, or use a debugger. A forked child
// does not have the region, and must not use its copy of the tree.
//
// The owner takes the memory of a page from the host before it writes to it (fallocate): where the
// host has none, the write is rejected. To touch a page that cannot be had would end the process
// (SIGBUS). Readers touch nothing behind the end of the file: see shared/mapped_memory.hpp.
//
// Thread safety: every function, from any thread. Lock order: see tree_state.hpp.
// Invariant: memory that was given out stays valid for the region's life.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string_view>
#include <vector>

#include "base/options.hpp"
#include "system/memory_file.hpp"
#include "system/zeroed_array.hpp"

namespace ztf {

struct RegionHeader;
struct Frame;
struct FrameEvents;
struct NameEntry;

class Region {
 public:
  // With Options::shared the memory is a region, else private. Throws bad_alloc, and system_error
  // if there can be no region.
  explicit Region(const Options& options);
  ~Region();
  Region(const Region&) = delete;
  Region& operator=(const Region&) = delete;

  [[nodiscard]] RegionHeader& header() const noexcept { return *header_; }
  // Arrays of max_ids() + 1 zeroed records.
  [[nodiscard]] Frame* frames() const noexcept { return frames_; }
  [[nodiscard]] FrameEvents* events() const noexcept { return events_; }
  [[nodiscard]] NameEntry* names() const noexcept { return names_; }
  // max_authorities + 1 of them.
  [[nodiscard]] NameEntry* authorities() const noexcept { return authorities_; }

  struct Piece {
    std::byte* begin;  // aligned to 128 bytes
    std::size_t bytes;
  };
  // Returns zeroed memory of `wanted` bytes, or of at least `least` if there is not so much, or if
  // the file grows in smaller steps. Throws bad_alloc, and Rejected if the host has no memory left
  // for the region.
  Piece allocate(std::size_t least, std::size_t wanted);
  // Takes the memory of the frames' records from the host, up to this id. Requires the topology
  // mutex. Throws Rejected if the host has none left.
  void allocate_records(std::uint32_t last_id);

  // The file descriptor of the region, for reading. It belongs to the region; -1 if the memory is
  // private.
  [[nodiscard]] int descriptor() const noexcept { return file_ ? file_->descriptor() : -1; }

 private:
  struct alignas(128) Block {
    std::byte bytes[128];
  };

  template <class T>
  T* make_array(std::size_t size);
  void fill_header(const Options& options);
  // Takes the pages between two distances from the host, also behind the end of the file. Throws
  // Rejected.
  void allocate_pages(std::uint64_t begin, std::uint64_t end);
  // What every tree needs. Throws system_error.
  void allocate_first_pages();

  std::mutex mutex_;
  std::optional<MemoryFile> file_;  // none if the memory is private
  std::byte* region_ = nullptr;     // its mapping
  std::uint64_t bytes_ = 0;         // of the mapping: the most that the file may have
  std::uint64_t file_bytes_ = 0;    // of the file; guarded by the mutex
  std::uint32_t last_record_ = 0;   // up to which id records have memory
  std::uint32_t max_ids_ = 0;
  std::vector<ZeroedArray<Block>> blocks_;  // of private memory

  RegionHeader* header_ = nullptr;
  Frame* frames_ = nullptr;
  FrameEvents* events_ = nullptr;
  NameEntry *names_ = nullptr, *authorities_ = nullptr;
};

}  // namespace ztf
