// Memory for rings of samples: allocated piece by piece, freed as a whole with the tree.
//
// It comes in few large blocks, which can be huge pages: with many frames, each write goes to
// another ring, and would miss the TLB as well as the cache.
//
// Thread safety: allocate() from any thread. Its mutex is the last in the lock order, and rarely
// taken, as rings double.
// Invariant: memory that was given out stays valid for the arena's life.
#pragma once

#include <algorithm>
#include <cstddef>
#include <mutex>
#include <vector>

#include "long_wait.hpp"
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

  // Returns zeroed cache lines. Throws bad_alloc.
  Line* allocate(std::size_t lines) {
    const auto lock = lock_announced(mutex_);
    if (lines > left_) {
      // The rest of the last block stays unused.
      const std::size_t size = std::max(lines, kFirstBlock << std::min(blocks_.size(), kDoublings));
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
  static constexpr std::size_t kFirstBlock = 1024;  // lines: 64 KiB
  static constexpr std::size_t kDoublings = 9;      // up to 32 MiB

  std::mutex mutex_;
  std::vector<ZeroedArray<Line>> blocks_;
  Line* free_ = nullptr;
  std::size_t left_ = 0;
};

}  // namespace ztf
