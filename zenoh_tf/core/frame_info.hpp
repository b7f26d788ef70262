// What is known about frames and authorities beside their samples.
//
// Thread safety: the words of a frame are written by who holds it, those of an
// authority by anyone; all may be read at any time. A FrameInfo is of one instant.
#pragma once

#include <atomic>
#include <cstdint>

#include "frame.hpp"

namespace ztf {

using AuthorityId = std::uint32_t;  // 1, 2, ...; 0: none was named

// Rare events of a frame, counted, and the last of those that change its link.
struct FrameEvents {
  enum class Change : std::uint8_t { none, reparented, switched, authority };

  std::atomic<std::uint32_t> rewritten, dropped, reparented, switched, authority_changes;

  std::atomic<Stamp> change_stamp;  // of the row that did it
  std::atomic<AuthorityId> change_authority;
  std::atomic<FrameId> parent_before;
  std::atomic<bool> static_before;
  std::atomic<Change> change;
};

// What one commit did to its rows.
struct CommitTally {
  std::uint32_t stored = 0, dropped = 0, rewritten = 0, conflicts = 0;
};

// What an authority has done; "" is not counted. A line each: authorities write
// at the same time.
struct alignas(64) AuthorityCounters {
  // The usual commit stores one row and counts one word.
  std::atomic<std::uint64_t> single_commits, other_commits, stored_by_others;
  std::atomic<std::uint64_t> dropped, rewritten, conflicts;

  void count(const CommitTally& tally, bool one_row) noexcept {
    const auto add = [](std::atomic<std::uint64_t>& counter, std::uint32_t n) {
      if (n != 0) counter.fetch_add(n, std::memory_order_relaxed);
    };
    const bool single = one_row && tally.stored == 1;
    add(single ? single_commits : other_commits, 1);
    if (!single) add(stored_by_others, tally.stored);
    add(dropped, tally.dropped);
    add(rewritten, tally.rewritten);
    add(conflicts, tally.conflicts);
  }
  [[nodiscard]] std::uint64_t commits() const noexcept { return single_commits + other_commits; }
  [[nodiscard]] std::uint64_t stored() const noexcept { return single_commits + stored_by_others; }
};

struct FrameInfo {
  FrameId parent;
  AuthorityId authority;
  bool is_static;
  std::uint32_t samples, evicted;
  Stamp oldest, newest;
  Version version;

  FrameEvents::Change change;
  Stamp change_stamp;
  AuthorityId change_authority;
  FrameId parent_before;
  bool static_before;
};

}  // namespace ztf
