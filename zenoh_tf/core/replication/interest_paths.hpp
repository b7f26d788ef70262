// The frames on the paths between pairs of frames: those that an interested mirror has.
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
// Thread safety: one thread at a time. Others write the tree meanwhile.
#pragma once

#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tree_state.hpp"

namespace ztf {

class InterestPaths {
 public:
  using Pairs = std::vector<std::pair<std::string, std::string>>;

  // Without pairs, all frames of the tree, which must outlive this object.
  InterestPaths(const TreeState& tree, Pairs pairs) : tree_(tree), pairs_(std::move(pairs)) {}

  // Finds the frames, or some of them if there are more than `max_frames`. Throws bad_alloc.
  void find(std::size_t max_frames);
  // Whether all that find() has read was the tree's state at one instant, now or before. If not,
  // frames() is unspecified.
  [[nodiscard]] bool is_valid() const;
  [[nodiscard]] const std::vector<FrameId>& frames() const noexcept { return frames_; }

  // Keeps what find() has found for may_differ().
  void keep();
  // Whether find() may find other frames than those kept. False only if it would not. Does not see
  // that a kept frame has another version. Always true without pairs.
  [[nodiscard]] bool may_differ() const;

 private:
  struct Link {
    Version version;
    FrameId parent;
    bool has_several_parents, is_removed;
  };

  // The name that refs_[i] is of.
  [[nodiscard]] const std::string& name(std::size_t i) const noexcept {
    return i % 2 ? pairs_[i / 2].second : pairs_[i / 2].first;
  }
  void add_paths(FrameId a, FrameId b);
  void add_all_ancestors(FrameId id);
  const Link& link(FrameId id);
  [[nodiscard]] Link read_link(FrameId id) const;
  void list_path(FrameId id, std::vector<FrameId>& path);

  const TreeState& tree_;
  const Pairs pairs_;

  // As of the last keep().
  std::vector<NameRef> kept_refs_;
  // Frames that the mirror does not have, but may need as soon as they get another parent or their
  // name back: those above the common ancestors, and past parents that were removed.
  std::vector<std::pair<FrameId, Link>> watched_;

  // As of the last find().
  std::uint64_t ids_freed_ = 0;
  std::uint32_t size_ = 0;
  std::vector<NameRef> refs_;  // of the pairs' names
  std::unordered_map<FrameId, Link> links_;
  std::unordered_map<FrameId, bool> wanted_;
  std::vector<FrameId> frames_;
  std::vector<ReadVersion> reads_;
};

}  // namespace ztf
