// What is known about frames beside their samples.
//
// Thread safety: the words of a frame are written by who holds it, and may be
// read at any time. A FrameInfo is of one instant.
#pragma once

#include <atomic>
#include <cstdint>

#include "counters.hpp"
#include "frame.hpp"

namespace ztf {

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
