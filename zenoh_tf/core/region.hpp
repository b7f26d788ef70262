// The memory that lookups touch (layout.hpp): private, or a region that others can map read-only.
//
// The shared region is a memfd: a file without a name, whose pages take no memory until they are
// touched. Its size is fixed, so that no reader ever touches what is not there, and it is sealed,
// so that nobody but this process can write to it: not even who gets its file descriptor. A process
// of the same user, or root, could still do so with a debugger. A forked child does not have the
// region, and must not use its copy of the tree.
//
// Thread safety: every function, from any thread. The mutex is the last in the lock order.
// Invariant: memory that was given out stays valid for the region's life.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <string_view>
#include <vector>

#include "options.hpp"
#include "zeroed_array.hpp"

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
  // Returns zeroed memory of `wanted` bytes, or of at least `least` if there is not so much. Throws
  // bad_alloc.
  Piece allocate(std::size_t least, std::size_t wanted);

  // The file descriptor of the region, which belongs to it; -1 if the memory is private.
  [[nodiscard]] int descriptor() const noexcept { return descriptor_; }

 private:
  struct alignas(128) Block {
    std::byte bytes[128];
  };

  template <class T>
  T* make_array(std::size_t size);
  void map_region(std::uint64_t bytes);
  void unmap_region() noexcept;
  void fill_header(const Options& options);

  std::mutex mutex_;
  int descriptor_ = -1;
  std::byte* region_ = nullptr;             // null if the memory is private
  std::uint64_t bytes_ = 0;                 // of the region
  std::int64_t owner_ = 0;                  // the process that made the region
  std::vector<ZeroedArray<Block>> blocks_;  // of private memory

  RegionHeader* header_ = nullptr;
  Frame* frames_ = nullptr;
  FrameEvents* events_ = nullptr;
  NameEntry *names_ = nullptr, *authorities_ = nullptr;
};

}  // namespace ztf
