// The transform tree: what other parts of the project may ask of the core.
//
// A tree is a TreeState. The head of tree_state.hpp has the order of all locks, the states of a
// name and the invariants. The folders on top of that do the work: lookups/ reads it, commits/
// writes it, and replication/ copies it.
//
// Thread safety: every function, from any thread.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "commits/commit.hpp"
#include "estimates/cache.hpp"
#include "estimates/limits.hpp"
#include "lookups/late.hpp"
#include "lookups/lookup.hpp"
#include "lookups/park.hpp"
#include "tree_state.hpp"

namespace ztf {

// What a tree has, and what happened in it.
struct TreeTotals {
  std::uint64_t frames = 0, static_links = 0, samples = 0;
  std::uint64_t rewritten = 0, dropped = 0, evicted = 0;
};

class Tree : private TreeState {
 public:
  using TreeState::TreeState;

  // For replication/, for shared/lease.hpp, and for a BlockingWaiter (lookups/park.hpp).
  [[nodiscard]] TreeState& state() noexcept { return *this; }
  [[nodiscard]] const TreeState& state() const noexcept { return *this; }
  [[nodiscard]] const Options& options() const noexcept { return TreeState::options; }

  // Names.

  // Returns the frame's id; 0 if no frame has that name.
  [[nodiscard]] FrameId find(std::string_view name) const noexcept { return names.find(name); }
  using FrameRef = NameTable::Ref;
  // The same, so that is_current() shows after a read whether the id still belonged to the name.
  // A lookup's answer belongs to the names if their Refs were found before the lookup and are
  // current after it; if not, look the names up again. It succeeds unless one of them was removed.
  [[nodiscard]] FrameRef find_ref(std::string_view name) const noexcept {
    return names.find_ref(name);
  }
  // Whether the id has had that name all the time since (names/table.hpp). The frame may be
  // removed, and may have come back.
  [[nodiscard]] bool is_current(FrameRef ref) const noexcept { return names.is_current(ref); }
  // How often ids of removed names have been freed. While it is equal, all Refs are current.
  [[nodiscard]] std::uint64_t ids_freed() const noexcept {
    return TreeState::ids_freed.load(std::memory_order_acquire);
  }
  using TreeState::name;
  using TreeState::read_names;
  using TreeState::removed;
  // Returns the name of a frame of a failure; empty if it has lost its name since. Throws
  // bad_alloc.
  [[nodiscard]] std::string name(const Failure& failure, FrameId id) const {
    std::string name = id != 0 ? names.name(id) : std::string();
    if (failure.ids_freed != ids_freed()) name.clear();
    return name;
  }
  // The highest id of a frame so far. Not all below it need to be in use.
  [[nodiscard]] std::uint32_t size() const noexcept { return names.size(); }

  // Lookups (lookups/lookup.hpp).

  void lookup(const Query& query, Answer& answer) const { ztf::lookup(*this, query, answer); }
  void lookup_batch(std::span<const Query> queries, std::span<Answer> answers) const {
    ztf::lookup_batch(*this, queries, answers);
  }
  void lookup_transaction(std::span<const Query> queries, std::span<Answer> answers, ReadSet& reads,
                          std::size_t max_reads = kNoReadLimit) const {
    ztf::lookup_transaction(*this, queries, answers, reads, max_reads);
  }
  void lookup_velocity(const VelocityQuery& query, VelocityAnswer& answer) const {
    ztf::lookup_velocity(*this, query, answer);
  }
  void estimate(const EstimateQuery& query, EstimateAnswer& answer) const {
    ztf::estimate(*this, estimate_cache_, motion_limits_, query, answer);
  }
  [[nodiscard]] const EstimateCache& estimate_cache() const noexcept { return estimate_cache_; }
  void set_motion_limits(std::string_view child, const MotionLimits& limits) {
    motion_limits_.set(child, limits);
  }
  // Returns a copy of all.
  [[nodiscard]] auto all_motion_limits() const { return motion_limits_.all(); }
  MotionResult lookup_motion(const MotionQuery& query, Motion& motion, Answer& answer) const {
    return ztf::lookup_motion(*this, query, motion, answer);
  }
  Failure chain(const Query& query, std::vector<FrameId>& frames) const {
    return ztf::chain(*this, query, frames);
  }
  [[nodiscard]] std::vector<NamedInfo> ancestors(std::span<const FrameId> starts,
                                                 Stamp stamp) const {
    return ztf::ancestors(*this, starts, stamp);
  }
  // Returns the parent at a time, or of the newest sample for kNoStamp; 0 if there is none.
  [[nodiscard]] FrameId parent(FrameId frame, Stamp stamp) const {
    return read_parent(frames, frame, stamp);
  }
  // Parks the waiter unless its lookup is done (lookups/park.hpp).
  bool lookup_or_park(Waiter& waiter, std::size_t max_links = kNoReadLimit) const {
    return ztf::lookup_or_park(*this, waiter, max_links);
  }
  [[nodiscard]] WaitList& wait_list() const noexcept { return TreeState::wait_list; }
  // Counts a lookup that failed, or waited, for the link that was late (lookups/late.hpp).
  void count_failed(const Failure& failure, std::int64_t asked_at_ns) const {
    ztf::count_late(*this, find_late_link(*this, failure), asked_at_ns, Late::failed);
  }
  void count_waited(const LateLink& link, std::int64_t asked_at_ns) const noexcept {
    ztf::count_late(*this, link, asked_at_ns, Late::waited);
  }

  // Writes (commits/commit.hpp).

  void commit(const CommitRequest& request, std::span<std::uint8_t> stored) {
    ztf::commit(*this, request, stored);
  }
  // Returns why a commit has refused a row of its request (commits/commit.hpp).
  [[nodiscard]] Rejected rejection_of(const CommitRequest& request, const Row& row,
                                      std::uint8_t result) const {
    return ztf::rejection_of(*this, request, row, result);
  }
  void clear(bool keep_static, std::int64_t expires_ns = kNeverExpires) {
    ztf::clear(*this, keep_static, expires_ns);
  }
  void reset(std::int64_t expires_ns = kNeverExpires) { ztf::reset(*this, expires_ns); }
  void remove_frame(std::string_view name, bool subtree, std::int64_t expires_ns = kNeverExpires) {
    ztf::remove_frame(*this, name, subtree, expires_ns);
  }

  // What is known of frames and authorities, and what happened.

  using TreeState::authority;
  using TreeState::info;
  using TreeState::version;
  [[nodiscard]] const FrameEvents& events(FrameId id) const noexcept {
    return TreeState::events[id];
  }
  // The highest id of an authority so far. Not all below it need to be in use.
  [[nodiscard]] AuthorityId authorities() const noexcept { return TreeState::authorities.size(); }
  [[nodiscard]] bool freed(AuthorityId id) const noexcept {
    return TreeState::authorities.removed(id);
  }
  [[nodiscard]] AuthorityCounts authority_counts(AuthorityId id) const noexcept {
    return authority_counters.sum(id);
  }
  [[nodiscard]] std::uint64_t commits() const noexcept { return commit_count.sum(); }
  // How often a frame's history was cleared because time was set back.
  [[nodiscard]] std::uint64_t time_jumps() const noexcept { return TreeState::time_jumps.load(); }
  // How many rows were dropped because they were later than CommitRequest::max_stamp.
  [[nodiscard]] std::uint64_t from_future() const noexcept { return TreeState::from_future.load(); }
  // The bytes of all rings of samples, those that wait to be used again included.
  [[nodiscard]] std::uint64_t memory_bytes() const { return ring_arena.bytes(); }
  // Sums over all frames, those included that have lost their names since. The counters of events
  // never go back from one call to the next.
  [[nodiscard]] TreeTotals totals() const;
  struct NamedEvent {
    TreeEvent event;
    std::string frame, parent, parent_before;  // empty: none
  };
  // Returns what happened since the last call, and how many events found no room
  // (records/event_log.hpp).
  std::pair<std::vector<NamedEvent>, std::uint64_t> take_events();

  // Copies in other processes.

  // The change log; null if the tree has none.
  [[nodiscard]] ChangeLog* change_log() const noexcept { return TreeState::change_log.get(); }
  // Of a mirror (replication/change_replay.hpp): the tree's state is the original's after this
  // number.
  [[nodiscard]] Seq replayed() const noexcept {
    return TreeState::replayed.load(std::memory_order_acquire);
  }
  // The file descriptor of the tree's region, which belongs to the tree; -1 without
  // Options::shared.
  [[nodiscard]] int descriptor() const noexcept { return region.descriptor(); }
  using TreeState::begin_lease;
  // Of a recording: nobody will send what is missing. To be set before other threads have the tree.
  void set_recorded(bool recorded) noexcept { is_recorded_ = recorded; }
  [[nodiscard]] bool is_recorded() const noexcept { return is_recorded_; }
  using TreeState::begin_startup;
  using TreeState::startup;

 private:
  [[nodiscard]] TreeTotals sum_totals() const noexcept;

  // Beside the state: nothing but estimates knows of them.
  mutable EstimateCache estimate_cache_;
  MotionLimitTable motion_limits_;
  bool is_recorded_ = false;
};

}  // namespace ztf
