// The folder `replication/`: copies of a tree in other processes.
// In: a tree and its change log. Out: snapshots, changes, and a mirror that has replayed them.
// It may include base, records, histories, tree_state.hpp, commits, messages.
//
// Replaying another tree's snapshot and change log into this one, which is then its mirror.
//
// First the pieces of a snapshot with the number S are loaded, into an empty tree with the same
// options. Then the changes after S are applied. The mirror's state is the original's once all
// numbers are applied that were drawn until the last piece was read; only then may it be read. From
// then on, each apply() takes it from one state of the original to a later one, at one instant.
//
// A mirror that has only some of the frames loses those that it does not need any more, as if they
// were removed, and may get them back in a version that they have had
// (replication/interest_reader.hpp). The frame's own version must not go back, since readers rest
// on it. So its bits from kServerVersion on count how often that happened. They wrap after 65,536
// times; readers compare for equality, so one would be wrong only if just as many passed while it
// reads.
//
// Why a change is applied once, though the snapshot is no instant: frames keep the original's
// versions. A change is applied only if its version is later than the frame's. The frame is then as
// it was before the change, since the version counts all changes of the frame.
//
// How long readers wait: all frames of a message are locked at once. Histories that take long to
// write are therefore written before, as drafts; short changes are made in place.
//
// Thread safety: one thread at a time replays. Lookups continue meanwhile, as in any tree. Requires
// another mode than `giant`, whose lookups are not validated; the bindings refuse that one.
// Invariant: nobody else writes the tree.
// Links are not checked for cycles, since the original has done that.
#pragma once

#include <deque>
#include <span>
#include <string_view>
#include <vector>

#include "histories/draft.hpp"
#include "replication/columns.hpp"
#include "tree_state.hpp"

namespace ztf {

class ChangeReplay {
 public:
  explicit ChangeReplay(TreeState& tree) noexcept : tree_(tree) {}

  // Applies the changes at one instant. `last`: the original was so after this number. Requires
  // valid columns of fitting lengths. Throws Rejected and bad_alloc; then no frame is
  // changed, but names and authorities may be new.
  void apply(const ChangeColumns& changes, Seq last);
  // Adds the frames. Throws Rejected and bad_alloc; then some may be missing.
  void load(const FrameColumns& frames);
  // Says that frames may have samples of several parents (SnapshotPlan::ever_reparented). Requires
  // that nobody reads the tree yet.
  void set_ever_reparented() noexcept { tree_.ever_reparented.store(true); }

 private:
  // One change that is new to its frame, and the row of its sample, or of the parent that samples
  // lose, if any.
  struct Step {
    std::uint32_t change, row;
  };
  // One frame during apply().
  struct Target {
    FrameId id;
    std::uint32_t name;        // its index
    std::uint32_t begin, end;  // its changes: steps_[begin, end)
    std::uint32_t samples;     // that they add
    Version before;            // the original's; 0: the frame does not exist
    Version after;             // once they are applied, as the next two; 0: there are none
    bool is_live;
    AuthorityId authority;
    PreparedRing* ring;   // for samples that are inserted in place; null: there is room
    HistoryDraft* draft;  // null: the changes are applied in place
  };
  class InPlace;
  class InDraft;

  void find_names(std::span<const std::string_view> names);
  void find_authorities(std::span<const std::string_view> authorities);
  void list_targets(const ChangeColumns& changes);
  void list_steps(const ChangeColumns& changes);
  void add_step(const ChangeColumns& changes, Target& target, Step step) noexcept;
  void prepare(const ChangeColumns& changes);
  [[nodiscard]] bool needs_draft(const ChangeColumns& changes, const Target& target) const;
  [[nodiscard]] bool only_appends(const ChangeColumns& changes, const Target& target) const;
  void publish(const ChangeColumns& changes) noexcept;
  // Replays a frame's changes into a history, which is InPlace or InDraft.
  template <class History>
  void write(const ChangeColumns& changes, const Target& target, History& history) const;
  [[nodiscard]] FrameId parent_of(const ChangeColumns& changes, std::uint32_t row) const noexcept;
  void load_frame(const FrameColumns& frames, std::size_t i, std::size_t first);
  void give_back() noexcept;
  [[nodiscard]] HistoryLimits limits() const noexcept {
    return {tree_.options.cache_ns, tree_.options.max_samples_per_frame};
  }
  [[noreturn]] void reject_memory() const;

  TreeState& tree_;
  std::vector<FrameId> ids_;                // of the names
  std::vector<AuthorityId> authority_ids_;  // of the authorities
  std::vector<std::uint32_t> target_of_;    // by name: index in targets_
  std::vector<Target> targets_;             // ascending
  std::vector<Step> steps_;                 // by target, in the order of the changes
  FrameList frames_;                        // of targets_
  std::deque<HistoryDraft> drafts_;
  std::vector<PreparedRing> rings_;  // that no frame has: prepared ones, then those replaced
};

}  // namespace ztf
