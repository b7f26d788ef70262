// What an interested mirror was sent of each frame, and what has changed since.
//
// Thread safety: one thread at a time. Others write the tree meanwhile.
#pragma once

#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "replication/columns.hpp"
#include "replication/frame_copy.hpp"
#include "tree_state.hpp"

namespace ztf {

// A frame's state at one instant, of which the mirror may have a part.
struct InterestCopy : FrameCopy {
  FrameId id = 0;
  bool is_new = true;           // the mirror does not have the frame
  bool is_append = false;       // what it has of the history still belongs to it
  std::uint32_t first_new = 0;  // index of the first of samples() that was not sent
  std::string name;             // if it is new, as is `ref`
  NameRef ref;
};

class InterestDifference {
 public:
  InterestDifference(const TreeState& tree, bool newest_only)
      : tree_(tree), newest_only_(newest_only) {}

  // Copies a frame with the samples that were not sent, or `with_all`. Returns nothing if it has
  // not changed and is not wanted `with_all`. Throws bad_alloc.
  [[nodiscard]] std::optional<InterestCopy> copy(FrameId id, bool with_all) const;
  // Whether a frame that was sent has changed since.
  [[nodiscard]] bool has_changed() const;
  // Returns what has changed in these frames, which are all that the mirror is to have. `copies`
  // has those that copy() returned. Throws bad_alloc.
  [[nodiscard]] ChangeTable changes(const std::vector<FrameId>& frames,
                                    const std::vector<InterestCopy>& copies, bool ever_reparented);
  // Returns the same for a mirror that has nothing yet. Requires copies `with_all`.
  [[nodiscard]] ChangeTable all(const std::vector<InterestCopy>& copies) const;
  // Records that the changes were sent. Throws bad_alloc.
  void keep(std::vector<InterestCopy>& copies, bool ever_reparented);
  [[nodiscard]] std::size_t size() const noexcept { return sent_.size(); }

 private:
  struct Sent {
    NameRef ref;
    std::string name;
    Version version;
    Stamp newest;
    std::uint32_t edits;  // TreeState::edits
  };

  [[nodiscard]] std::uint32_t name(ChangeTable& table, FrameId id) const;
  void add(const InterestCopy& copy, std::size_t first, ChangeTable& table) const;

  const TreeState& tree_;
  const bool newest_only_;
  std::unordered_map<FrameId, Sent> sent_;
  bool sent_reparented_ = false;
  std::vector<FrameId> removed_;  // frames of sent_ that the last changes() has removed
};

}  // namespace ztf
