// The version of a frame. It changes with every commit to the frame, so readers, read sets and
// mirrors see by it that the frame has changed. A frame's SeqLock holds it
// (records/lock_words.hpp).
//
// Bits 0 and 1 are the SeqLock's, 2 to 47 count, and a mirror adds those from 48 on. 0: no commit
// has written the frame. Which version a frame gets:
//   commit          next_version(), if it changes the frame (commits/write_locks.hpp); the first
//                   reparenting: all frames (CommitExecution::frames_with_new_version, in
//                   commits/apply.hpp); next_version(0) for a new frame that is only a parent
//                   (commits/names.hpp)
//   freeing names   version_base or later, above those of all frames that lost their names
//                   (commits/freed_names.cpp)
//   mirror          the server's (replication/change_replay.cpp, change_load.cpp)
#pragma once

#include <cstdint>

namespace ztf {

using Version = std::uint64_t;

constexpr Version kVersionStep = 4;
// The bits of a mirror's version that are the server's.
constexpr Version kServerVersion = (Version{1} << 48) - 1;

// The version that a commit gives to a frame which it changes.
[[nodiscard]] constexpr Version next_version(Version before) noexcept {
  return before + kVersionStep;
}

}  // namespace ztf
