// Snapshots: all frames with their histories and versions, read in pieces while others write.
//
// A snapshot is not one instant. It has the number S of a commit, and each frame is as it was at
// some instant after that commit. Replaying the change log from S on makes it the tree's state
// (replication/change_replay.hpp).
//
// Thread safety: every function, from any thread. Readers and writers continue meanwhile.
// Invariant: whatever a commit up to S has done is in the snapshot, unless a later one undid it.
// Such a commit may still be in progress. Then readers wait for its frames, and it holds the
// topology mutex if it adds or removes names.
#pragma once

#include <vector>

#include "replication/columns.hpp"
#include "replication/frame_copy.hpp"
#include "tree_state.hpp"

namespace ztf {

struct SnapshotPiece {
  FrameId reached;  // the last id that was read
  FrameTable frames;
};

struct SnapshotPlan {
  Seq seq;               // S
  bool ever_reparented;  // frames may have samples of several parents
  // The pieces: frames with ids above the first bound, up to the second, and so on. Frames that are
  // added later are in the change log.
  std::vector<FrameId> bounds;
};

class SnapshotReader {
 public:
  explicit SnapshotReader(TreeState& tree) noexcept : tree_(tree) {}

  // Plans pieces of about this many bytes. A piece has whole frames. Requires a change log. Throws
  // bad_alloc.
  [[nodiscard]] SnapshotPlan plan(std::size_t piece_bytes);
  // Reads the frames with ids above `after`, up to `last`, or until they have `most_bytes` or more.
  // Throws bad_alloc.
  [[nodiscard]] SnapshotPiece read(FrameId after, FrameId last, std::size_t most_bytes);

 private:
  [[nodiscard]] SnapshotPiece read_once(FrameId after, FrameId last, std::size_t most_bytes);
  void add_frame(FrameId id, FrameTable& frames);

  TreeState& tree_;
  FrameCopy copy_;
};

}  // namespace ztf
