// Memory for rings of samples: allocated piece by piece, freed as a whole with the tree.
//
// It comes in few large blocks, which can be huge pages: with many frames, each write goes to
// another ring, and would miss the TLB as well as the cache. Rings that are given back are kept by
// their capacity, for the next rings of that capacity.
//
// Why a ring may be used again although readers may still read it. A frame's ring is given back
// only after the frame has got a new version without that ring. A reader that loads anything that
// the next owner has stored there has acquired what happened before, which includes that version.
// So its validation of the first frame fails, as after any torn read
// (docs/explanation/concurrency.md). The words of a ring are atomics at the same places whoever
// owns it, and its memory stays valid, so a late reader is safe until it validates.
//
// Thread safety: every function, from any thread. The mutex is rarely taken, as rings double. Lock
// order: see tree_state.hpp.
// Invariant: memory that was given out stays valid for the arena's life.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <mutex>

#include "base/long_wait.hpp"
#include "records/region.hpp"

namespace ztf {

class RingArena {
 public:
  // A cache line.
  struct alignas(64) Line {
    // Of a free ring: the distance in bytes from here to the next one of its capacity; 0: none. No
    // address, as other processes can read it. It overlaps the first sample's stamp.
    std::atomic<std::uint64_t> to_next;
    std::byte bytes[56];
  };
  // Thrown if allocate() would exceed the limit.
  struct Full {};

  // With max_bytes 0 there is no limit. Requires that the region outlives this object.
  RingArena(Region& region, std::uint64_t max_bytes)
      : region_(region), max_lines_(max_bytes / sizeof(Line)) {}
  RingArena(const RingArena&) = delete;
  RingArena& operator=(const RingArena&) = delete;

  // Returns the cache lines of a ring of 2^logarithm samples: zeroed, or as they were given back.
  // Throws Full and bad_alloc, and Rejected if the host has no memory for a region.
  Line* allocate(unsigned logarithm, std::size_t lines) {
    const auto lock = lock_announced(mutex_);
    if (Line* const ring = free_rings_[logarithm]) {
      const std::uint64_t to_next = ring->to_next.load(std::memory_order_relaxed);
      free_rings_[logarithm] =
          to_next == 0 ? nullptr : reinterpret_cast<Line*>(address(ring) + to_next);
      return ring;
    }
    if (max_lines_ != 0 && lines_ + lines > max_lines_) throw Full();
    if (lines > left_) {
      // The rest of the last block stays unused, unless the new one follows it.
      const std::size_t size = std::max(lines, kFirstBlock << std::min(blocks_, kDoublings));
      const Region::Piece block = region_.allocate(lines * sizeof(Line), size * sizeof(Line));
      ++blocks_;
      if (reinterpret_cast<Line*>(block.begin) != free_ + left_) {
        free_ = reinterpret_cast<Line*>(block.begin);
        left_ = 0;
      }
      left_ += block.bytes / sizeof(Line);
    }
    Line* const taken = free_;
    free_ += lines;
    left_ -= lines;
    lines_ += lines;
    return taken;
  }

  // Takes back what allocate() has returned. Requires that no frame has the ring, and that the one
  // that had it last has got a new version since.
  void give_back(unsigned logarithm, Line* ring) noexcept {
    const auto lock = lock_announced(mutex_);
    const Line* const next = free_rings_[logarithm];
    ring->to_next.store(next ? address(next) - address(ring) : 0, std::memory_order_release);
    free_rings_[logarithm] = ring;
  }

  // The bytes of all rings, in use or not. It does not shrink.
  [[nodiscard]] std::uint64_t bytes() const {
    const auto lock = lock_announced(mutex_);
    return lines_ * sizeof(Line);
  }

 private:
  static std::uintptr_t address(const Line* line) noexcept {
    return reinterpret_cast<std::uintptr_t>(line);
  }

  static constexpr std::size_t kFirstBlock = 1024;  // lines: 64 KiB
  static constexpr std::size_t kDoublings = 9;      // up to 32 MiB

  mutable std::mutex mutex_;
  Region& region_;
  const std::uint64_t max_lines_;
  std::uint64_t lines_ = 0;  // given out, ever
  std::size_t blocks_ = 0;
  Line* free_ = nullptr;
  std::size_t left_ = 0;
  std::array<Line*, 64> free_rings_{};  // by the capacity's logarithm
};

}  // namespace ztf
