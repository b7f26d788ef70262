// Mode `giant`: one mutex around each transaction, as in tf2.
//
// Nothing is validated, as no commit runs beside a lookup. A commit takes the frames' SeqLocks as
// in the other modes, for readers of other processes and of single frames.
//
// Thread safety: every function, from any thread. A guard belongs to one thread.
#pragma once

#include <mutex>

#include "base/long_wait.hpp"
#include "tree_state.hpp"

namespace ztf {

// Requires that the caller holds the tree's giant mutex for the guard's lifetime.
class GiantGuard : public RecordingGuard {
 public:
  using RecordingGuard::RecordingGuard;
  bool read_version(const Frame& frame, Version& version) const {
    version = frame.version.current();
    return true;
  }
};

struct Giant {
  // Waits for the mutex, which a transaction holds until it ends.
  [[nodiscard]] static std::unique_lock<std::mutex> lock(const TreeState& tree) {
    return lock_announced(tree.giant);
  }
  template <class Attempt>
  static void read(const TreeState& tree, ReadSet& reads, Attempt&& attempt) {
    const auto lock = Giant::lock(tree);
    GiantGuard guard(tree.frames, reads);
    attempt(guard);
  }
};

}  // namespace ztf
