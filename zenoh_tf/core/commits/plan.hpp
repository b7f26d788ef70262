// What a commit will do: its rows in order, grouped by child, with a decision for each group.
//
// A commit is a plan and its execution (commits/apply.hpp). Planning rejects the request, reserves
// memory for samples and names, and assigns ids to new names. commit() (commits/commit.cpp) takes
// the locks between the steps.
//
// Thread safety: lives on the writer's stack. Each step says which locks it requires.
// Invariants
// 1. After a retry all steps run again. Rows that an attempt has refused stay refused.
// 2. Planning changes nothing that readers can see, also for a commit that is then rejected, but
//    the marks of late samples (FrameEvents), and removed names that it frees for their ids.
#pragma once

#include <span>

#include "commits/names.hpp"
#include "commits/write_locks.hpp"
#include "histories/write.hpp"

namespace ztf {

// What an attempt to commit locks. Each scope includes the one before.
enum class CommitScope : std::uint8_t {
  children,    // the frames that get samples
  topology,    // and the topology mutex: names may be added, newest parents may change
  all_frames,  // and every frame: the first reparenting may happen
};

// Whether a plan can be applied in the scope of its attempt, or which scope it needs.
enum class PlanOutcome : std::uint8_t {
  ready,
  needs_topology,
  needs_all_frames,
  rows_refused,  // the next attempt in the same scope plans without them
};

// One row of the request, with its names resolved. Its pose is CommitPlan::pose(row).
struct RowWrite {
  FrameId child, parent;
  std::uint32_t row;  // index in the request
  Stamp stamp;
};

// The rows of one child, in the order of their stamps, and what they will do to its frame. Here the
// newest sample is that of the frame before the commit.
struct FrameWrites {
  Frame* frame;
  FrameId child;
  std::uint32_t begin, end;  // the rows: CommitPlan::writes()[begin, end)
  FrameId new_parent = 0;    // the frame's parent after this commit; 0: as before
  bool is_linked = false;    // check_links() takes the new parent for the frame's
  // A stored row has another parent than the newest sample. Also set if a later row restores the
  // parent, or the sample is late: the topology mutex must keep that parent from being removed.
  bool stores_other_parent = false;
  bool is_append = false;    // one row, newer than the newest sample, of its parent and authority
  bool restarts = false;     // time was set back: the history is cleared before the rows are stored
  bool jumps_ahead = false;  // time jumped ahead: the rows will prune the history
  std::uint32_t ring = 0;    // index of its prepared ring, plus 1; 0: none
  bool wakes_all = false;    // not only newer samples of the same parent: all waiters are woken
};

class CommitPlan {
 public:
  // Checks what can be checked without a lock: names, stamps and poses. Throws Rejected.
  CommitPlan(TreeState& tree, const CommitRequest& request, std::span<std::uint8_t> stored);
  ~CommitPlan() {
    if (prepared_rings_.size() != 0) give_back_rings();
  }
  CommitPlan(const CommitPlan&) = delete;
  CommitPlan& operator=(const CommitPlan&) = delete;

  // The scope of the first attempt.
  [[nodiscard]] CommitScope initial_scope() const noexcept;

  // Step 1: resolves names, sorts the rows by child and time, and groups them by child. Requires
  // the scope's mutex, if any. Returns false if a name or the authority is new, and adding it needs
  // the topology mutex. Throws Rejected and bad_alloc.
  bool resolve_and_group(CommitScope scope);

  // The frames that get samples, ascending. The next steps require their write locks.
  [[nodiscard]] const FrameList& children() const noexcept { return children_; }
  // All frames, ascending, with the children that this commit creates. In the scope all_frames the
  // next steps require their write locks instead.
  void list_all_frames(FrameList& all) const;

  [[nodiscard]] bool has_read_set() const noexcept { return !request_.read_names.empty(); }

  // Step 2: checks that every version which the transaction has read is unchanged. Requires the
  // write locks, and that WriteLocks::begin_write() has been called: so at most one of two commits
  // passes if each has read what the other writes. Throws Rejected.
  void validate_read_set(const WriteLocks& locks) const;

  // Throws Rejected if the request has expired. To be called when nothing is left to wait for.
  void check_expiry() const { check_not_expired(request_.expires_ns); }

  // Step 3: decides what each group stores, and reserves memory for it. Requires the write locks.
  // Throws Rejected and bad_alloc.
  PlanOutcome decide(CommitScope scope);

  // The results, once decide() has returned ready.
  [[nodiscard]] const CommitRequest& request() const noexcept { return request_; }
  [[nodiscard]] std::span<const FrameWrites> groups() const noexcept {
    return {groups_.begin(), groups_.size()};
  }
  [[nodiscard]] const RowWrite& write(std::uint32_t i) const noexcept { return writes_[i]; }
  [[nodiscard]] const Pose& pose(std::uint32_t row) const noexcept { return poses_[row]; }
  [[nodiscard]] bool is_stored(std::uint32_t row) const noexcept {
    return stored_[row] == RowResult::stored;
  }
  [[nodiscard]] bool is_refused(std::uint32_t row) const noexcept {
    return RowResult::is_refusal(stored_[row]);
  }
  // The new ring of a group that has one. Once it is published, the one that it replaced.
  [[nodiscard]] PreparedRing& prepared_ring(const FrameWrites& group) noexcept {
    return prepared_rings_[group.ring - 1];
  }
  // True if planning takes so long that readers should continue meanwhile. Requires
  // resolve_and_group(). It needs no lock: if another writer interferes, readers may wait longer.
  [[nodiscard]] bool is_long() const noexcept {
    return writes_.size() > kLong || (groups_.size() == 1 && may_copy_history(groups_[0]));
  }
  // How many rows are dropped because they are later than the request's max_stamp.
  [[nodiscard]] std::uint32_t from_future() const noexcept { return from_future_; }
  // True if every row of the request is dropped or refused.
  [[nodiscard]] bool has_no_rows_left() const noexcept {
    return writes_.size() == 0 && !request_.rows.empty();
  }
  [[nodiscard]] const CommitNames& names() const noexcept { return names_; }
  [[nodiscard]] const HistoryLimits& limits() const noexcept { return limits_; }
  // True if this commit is the first in the tree's life that may leave a frame with samples of two
  // parents.
  [[nodiscard]] bool is_first_reparenting() const noexcept { return is_first_reparenting_; }
  // The group of a child, or null.
  [[nodiscard]] const FrameWrites* group_of(FrameId child) const noexcept;

 private:
  enum class RowFate : std::uint8_t { stored, too_old, no_room };

  void refuse(std::uint32_t row, std::uint8_t result);
  void refuse_group(const FrameWrites& group, std::uint8_t result);
  [[nodiscard]] PlanOutcome remove_refused() noexcept;
  void assign_new_ids();
  void sort_rows();
  void group_rows();
  [[nodiscard]] bool create_parent(RowWrite& write);
  [[nodiscard]] bool refuse_strays(FrameWrites& group, std::uint32_t begin, Stamp newest) noexcept;
  [[nodiscard]] bool restarts_history(const FrameWrites& group, Stamp newest) const noexcept;
  [[nodiscard]] bool is_after_pause(const FrameWrites& group, Stamp stamp,
                                    Stamp newest) const noexcept;
  [[nodiscard]] bool jumps_ahead(const FrameWrites& group, std::uint32_t begin,
                                 Stamp newest) const noexcept;
  void record_late(const FrameWrites& group, Stamp newest) const noexcept;
  [[nodiscard]] bool is_append(const FrameWrites& group) const noexcept;
  void decide_rows(FrameWrites& group);
  [[nodiscard]] RowFate fate_of(const RowWrite& write, bool has_samples, Stamp newest,
                                Stamp oldest_of_full) const noexcept;
  [[noreturn]] void reject_stamp(const RowWrite& write, RowFate fate, Stamp newest,
                                 Stamp oldest) const;
  // Refuses links that would close a cycle, or put their child too deep. Requires the topology
  // mutex. Throws Rejected and bad_alloc.
  void check_links();
  void check_links_one_by_one();
  [[nodiscard]] std::uint8_t check_link(const FrameWrites& group) const noexcept;
  [[nodiscard]] bool may_copy_history(const FrameWrites& group) const noexcept;
  void reserve_memory();
  void prepare_ring(FrameWrites& group);
  void give_back_rings() noexcept;

  static constexpr std::size_t kLong = 16;  // rows

  TreeState& tree_;
  const CommitRequest& request_;
  const std::span<std::uint8_t> stored_;  // by row of the request
  const HistoryLimits limits_;
  CommitNames names_;
  std::uint32_t from_future_ = 0;
  bool is_first_reparenting_ = false;
  bool has_refused_groups_ = false;   // in this attempt
  SmallVector<RowWrite, 16> writes_;  // without the rows that are refused
  SmallVector<Pose, 16> poses_;       // by row of the request, normalised
  SmallVector<FrameWrites, 16> groups_;
  // Rings that no frame has: those that this attempt has prepared, then those that they replaced.
  SmallVector<PreparedRing, 1> prepared_rings_;
  FrameList children_;  // of groups_, ascending
};

}  // namespace ztf
