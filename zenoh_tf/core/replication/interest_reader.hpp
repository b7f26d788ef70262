// What an interested mirror has of a tree: the frames on the paths between pairs of frames. Returns
// what has changed in them since the last read, read at one instant from the tree itself.
//
// A read has three parts: the frames on the paths (replication/interest_paths.hpp), a copy of each
// (replication/frame_copy.hpp), and the difference from what was sent
// (replication/interest_difference.hpp).
//
// A commit pays nothing for it. A read copies the frames' newest links, walks them, copies what is
// new of each history, and compares all versions at the end. If they have not moved, there was an
// instant at which all of it was the tree's state (reads/guards.hpp). After some failed attempts it
// takes the frames' writer locks.
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
#include <vector>

#include "replication/interest_difference.hpp"
#include "replication/interest_paths.hpp"

namespace ztf {

class InterestReader {
 public:
  using Pairs = InterestPaths::Pairs;

  // Without pairs, of all frames. With `newest_only`, returns a frame's newest sample only.
  // Requires a change log, and that the tree outlives this object.
  InterestReader(TreeState& tree, Pairs pairs, bool newest_only)
      : tree_(tree), paths_(tree, std::move(pairs)), difference_(tree, newest_only) {}

  struct Result {
    Seq seq;
    bool ever_reparented;  // frames may have samples of several parents
    ChangeTable changes;   // since the last read
    ChangeTable all;       // as for a mirror that has nothing yet; empty if not asked for
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
  [[nodiscard]] std::optional<Result> try_read(bool with_all, std::size_t max_frames);
  [[nodiscard]] Result read_locked(bool with_all, std::size_t max_frames);
  [[nodiscard]] Seq last_number() const noexcept;
  void check_frames(std::size_t max_frames) const;
  void copy_frames(bool with_all);
  [[nodiscard]] bool is_valid() const;
  [[nodiscard]] Result make_result(Seq seq, bool with_all);
  void keep(const Result& result);

  TreeState& tree_;

  std::atomic<std::size_t> sent_frames_{0};
  mutable std::mutex mutex_;  // guards what follows
  InterestPaths paths_;
  InterestDifference difference_;
  Seq sent_seq_ = 0;
  std::vector<InterestCopy> copies_;  // of the frames whose versions were not sent
};

}  // namespace ztf
