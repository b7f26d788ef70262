// What is known about a frame beside its samples.
//
// Thread safety: FrameEvents are written under the frame's write lock, and may be read at any time,
// each word by itself. A FrameInfo is a value that was read at one instant.
#pragma once

#include <atomic>
#include <cstdint>

#include "counters.hpp"
#include "frame.hpp"

namespace ztf {

// How often rare events happened to a frame, and the last one that changed its link.
struct FrameEvents {
  enum class Change : std::uint8_t { none, reparented, switched, authority };

  // Samples replaced at their stamp, rows dropped as too old, new parents, changes between static
  // and dynamic, new authorities.
  std::atomic<std::uint32_t> rewritten, dropped, reparented, switched, authority_changes;

  // The last change of the link, and what the link was before.
  std::atomic<Stamp> change_stamp;  // of the row that made the change
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
