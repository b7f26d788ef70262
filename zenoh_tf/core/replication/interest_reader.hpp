// What an interested mirror has of a tree: the frames on the paths between pairs of frames. Returns
// what has changed in them since the last read, read at one instant from the tree itself.
//
// A commit pays nothing for it. A read copies the frames' newest links, walks them, copies what is
// new of each history, and compares all versions at the end. If they have not moved, there was an
// instant at which all of it was the tree's state (reads/guards.hpp). After some failed attempts it
// takes the frames' writer locks.
//
// The paths: for each pair the frames up to the lowest common ancestor, that one included; all
// ancestors of both if they have none. If a frame on the paths from the pair to the root has
// samples of several parents, all ancestors of both in all of their samples: past paths may differ,
// and may lead from above the common ancestor back to the pair or into a loop.
//
// Failures: a lookup of a pair answers in the mirror as in the tree, and fails with the same code.
// There is one exception. If several links have no sample at the time, the tree reports the first
// one on the target's path to its root (Reader::report_failure), which may be above the common
// ancestor. If the mirror does not have that link, it reports the next. The codes are then
// `no_data`, `backward` or `forward` both, but perhaps not the same one.
//
// Thread safety: all functions, from any thread.
// Invariants
// 1. A mirror that was given `all` of one read, and applies the `changes` of all later ones in
//    order, has the tree's state as of the last one, in the frames on the paths.
// 2. All commits up to Result::seq are in the state. Later ones may be, each as a whole.
// 3. A result with `changes` has a later `seq` than the result before it.
#pragma once

#include <atomic>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "records/change_log.hpp"
#include "tree_state.hpp"

namespace ztf {

// Changes as columns, with texts of their own; else as ChangeBatch (replication/change_batch.hpp).
struct ChangeRows {
  std::vector<std::string> names, authorities;
  std::vector<ChangeKind> kind;
  std::vector<std::uint32_t> frame;
  std::vector<Version> version;
  std::vector<std::uint32_t> parent, authority;  // a parent that was removed: kNoParent
  std::vector<Stamp> stamp;
  std::vector<Pose> pose;
  std::vector<std::uint32_t> lost;  // none: a history that loses parents is sent as a whole
};

class InterestReader {
 public:
  using Pairs = std::vector<std::pair<std::string, std::string>>;

  // Without pairs, of all frames. With `newest_only`, returns a frame's newest sample only.
  // Requires a change log, and that the tree outlives this object.
  InterestReader(TreeState& tree, Pairs pairs, bool newest_only);

  struct Result {
    Seq seq;
    bool ever_reparented;  // frames may have samples of several parents
    ChangeRows changes;    // since the last read
    ChangeRows all;        // as for a mirror that has nothing yet; empty if not asked for
  };
  // Throws Rejected if there are more than `max_frames` frames on the paths, and bad_alloc; then
  // the next read() returns the same changes.
  Result read(bool with_all, std::size_t max_frames);

  // Returns whether read() may return a change. False only if it would not. Always true without
  // pairs.
  [[nodiscard]] bool has_changed() const;
  // The number of frames as of the last read(). Does not wait for one in progress.
  [[nodiscard]] std::size_t frames() const noexcept {
    return sent_frames_.load(std::memory_order_relaxed);
  }

 private:
  // What earlier reads have returned of a frame.
  struct Sent {
    NameRef ref;
    std::string name;
    Version version;
    Stamp newest;
    std::uint32_t edits;  // TreeState::edits
  };
  struct Link {
    Version version;
    FrameId parent;
    bool has_several_parents, is_removed;
  };
  struct CopiedSample {
    Stamp stamp;
    FrameId parent;
    Pose pose;
  };
  // A frame's state at one instant.
  struct Copy {
    FrameId id;
    std::string name;  // if it is new
    NameRef ref;
    Version version;
    FrameId parent;
    AuthorityId authority;
    Stamp oldest;
    std::uint32_t edits, count;
    std::uint32_t first_new;  // index of the first of `samples` that was not sent
    bool is_static, is_new, is_append, fits;
    std::vector<CopiedSample> samples;
  };
  class Rows;

  [[nodiscard]] std::optional<Result> try_read(bool with_all, std::size_t max_frames);
  [[nodiscard]] Result read_locked(bool with_all, std::size_t max_frames);
  void begin_attempt();
  void find_frames(std::size_t max_frames);
  void check_frames(std::size_t max_frames) const;
  void add_paths(FrameId a, FrameId b);
  void add_all_ancestors(FrameId id);
  const Link& link(FrameId id);
  [[nodiscard]] Link read_link(FrameId id) const;
  void list_path(FrameId id, std::vector<FrameId>& path);
  void copy_frames(bool with_all);
  void copy_frame(Copy& copy, const Sent* sent, bool with_all);
  [[nodiscard]] bool is_valid() const;
  [[nodiscard]] Result make_result(bool with_all);
  void keep_sent();
  void add_frame(const Copy& copy, bool all, Rows& rows) const;

  TreeState& tree_;
  const Pairs pairs_;
  const bool newest_only_;

  std::atomic<std::size_t> sent_frames_{0};
  mutable std::mutex mutex_;  // guards what follows
  std::unordered_map<FrameId, Sent> sent_;
  std::vector<NameRef> refs_;  // of the pairs' names, as of the last read
  // Frames that the mirror does not have, but may need as soon as they get another parent or their
  // name back: those above the common ancestors, and past parents that were removed.
  std::vector<std::pair<FrameId, Link>> watched_;
  bool sent_reparented_ = false;
  Seq sent_seq_ = 0;

  // Of one attempt.
  Seq seq_ = 0;
  std::uint64_t ids_freed_ = 0;
  std::uint32_t size_ = 0;
  bool ever_reparented_ = false;
  std::vector<NameRef> new_refs_;
  std::unordered_map<FrameId, Link> links_;
  std::unordered_map<FrameId, bool> wanted_;
  std::vector<FrameId> frames_;
  std::vector<ReadVersion> reads_;
  std::vector<Copy> copies_;      // of the frames whose versions were not sent
  std::vector<FrameId> removed_;  // the frames of sent_ that are no longer on the paths
};

}  // namespace ztf
