// Memory for rings of samples, given out piece by piece and taken back as a whole.
//
// Thread safety: all of it. The mutex comes after all other locks, and is rarely taken: rings
// double. In few large blocks, for huge pages: where frames are many, each write comes to another
// ring.
#pragma once

#include <algorithm>
#include <cstddef>
#include <mutex>
#include <vector>

#include "zeroed_array.hpp"

namespace ztf {

class RingArena {
 public:
  // A cache line.
  struct alignas(64) Line {
    std::byte bytes[64];
  };

  RingArena() = default;
  RingArena(const RingArena&) = delete;
  RingArena& operator=(const RingArena&) = delete;

  // Zeroed lines, for as long as this lives. Throws bad_alloc.
  Line* allocate(std::size_t lines) {
    const std::lock_guard lock(mutex_);
    if (lines > left_) {
      // What is left of the last block stays unused: less than a ring.
      const std::size_t size = std::max(lines, kFirst << std::min(blocks_.size(), kDoublings));
      blocks_.emplace_back(size);
      free_ = blocks_.back().begin();
      left_ = size;
    }
    Line* const taken = free_;
    free_ += lines;
    left_ -= lines;
    return taken;
  }

 private:
  static constexpr std::size_t kFirst = 1024;   // 64 KiB
  static constexpr std::size_t kDoublings = 9;  // to 32 MiB

  std::mutex mutex_;
  std::vector<ZeroedArray<Line>> blocks_;
  Line* free_ = nullptr;
  std::size_t left_ = 0;
};

}  // namespace ztf
