// What a tree is made with.
//
// Thread safety: values.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>

namespace ztf {

enum class Concurrency : std::uint8_t {
  optimistic,  // readers take no locks and validate versions; a commit locks the frames it writes
  two_phase,   // readers and commits lock their frames and unlock them only at the end
  giant,       // one mutex for every transaction
};

struct Options {
  std::uint64_t cache_ns = 10'000'000'000;  // less than 2^63
  Concurrency concurrency = Concurrency::optimistic;
  std::uint32_t max_frames = 1u << 20;
  std::uint32_t max_samples_per_frame = 1u << 16;
  std::uint32_t max_name_bytes = 255;
  // The most links between a frame and its root: a commit whose child would be deeper is rejected.
  // It also ends lookups at past times, whose links may form a loop, and those of frames that a
  // moved parent has taken deeper. 0: no limit.
  std::uint32_t max_depth = 1000;
  // If there are more, those that own no frame are freed, the least recently used first.
  std::uint16_t max_authorities = 4096;
  // Most bytes of all rings of samples; 0: no limit. A ring that is not used any more counts until
  // a frame needs one of its capacity.
  std::uint64_t max_memory_bytes = 0;
  bool one_authority_per_frame = false;
  // Two commits in a row whose rows of a frame are too old mean that time was set back, if the
  // second's are newer: it clears the frame's history and stores its rows. Without this option it
  // does so only if the history ends ahead of the real-time clock (CommitPlan::restarts_history).
  bool clear_on_time_jump = false;
  // Most bytes of the change log's entries; 0: the tree has no log.
  std::uint64_t max_log_bytes = 0;
  // Keeps what lookups touch in memory that other processes can map read-only (records/region.hpp).
  bool shared = false;
  // Which server this is, for these processes; at most 63 bytes.
  std::string instance = {};

  // A tree has more ids than frames. So at the limit of frames, too, ids are freed only after many
  // removals, and each bears a small part of what it costs to look at all frames
  // (commits/freed_names.cpp).
  [[nodiscard]] std::uint32_t max_ids() const noexcept { return max_frames + max_frames / 16; }
  // The most links that a walk upwards follows. Without a limit of depths it ends in a loop, too.
  [[nodiscard]] std::uint32_t max_path() const noexcept {
    return max_depth != 0 ? std::min(max_depth, max_ids()) : max_ids();
  }
};

}  // namespace ztf
