// The transform tree: every frame's record, the names, and the two kinds of transactions, reads
// and commits. Needs a 64-bit target (records/frame.hpp).
//
// A tree is made of the rooms below it, from base/ to waiting/. The rooms above define its members
// and use what they share: commits/, replication/, lookups/. docs/explanation/architecture.md has
// all rooms.
//
// Thread safety: every function, from any thread.
// Lock order, of the whole core. A thread takes a lock only while it holds none of a later line:
//   replication/interest_reader.hpp  the reader's mutex: around a whole read of the interest
//   tree.hpp                         the giant mutex: around each transaction in mode giant
//   tree.hpp                         the topology mutex: names are added, newest parents change
//   waiting/wait_list.hpp            the list's mutex: its holder may lock one frame for a moment
//   records/lock_words.hpp           the frames' locks, in ascending order of ids
//   records/ring_arena.hpp           the arena's mutex: a ring doubles
//   records/region.hpp               the region's mutex: arena or table of names takes a block
// Leaves, whose holders take no other lock: the mutexes of records/event_log.hpp, of
// records/change_log.hpp, of a BlockingWaiter (waiting/wait_list.hpp), and of shared/lease.hpp.
// Lookups take none of the mutexes but the giant one. A lookup that retries too often takes the
// frames' locks.
// Invariants
// 1. Frames are never freed or moved: an id stays valid for the tree's life. It may pass from a
//    removed name to a new one (commits/freed_names.cpp), which is_current() notices.
// 2. The newest parents form a forest. A commit that changes one, or adds a name, holds the
//    topology mutex and has checked that no cycle closes.
// 3. A rejected commit leaves nothing behind, not even a name.
// 4. The versions of a name only grow, also if it comes back under another id.
#pragma once

#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/options.hpp"
#include "base/rejected.hpp"
#include "base/zeroed_array.hpp"
#include "histories/history.hpp"
#include "names/table.hpp"
#include "reads/guards.hpp"
#include "reads/query.hpp"
#include "reads/velocity.hpp"
#include "records/change_log.hpp"
#include "records/counters.hpp"
#include "records/event_log.hpp"
#include "records/frame_info.hpp"
#include "records/layout.hpp"
#include "records/region.hpp"
#include "records/topology_index.hpp"
#include "waiting/wait_list.hpp"

namespace ztf {

// The expiry of a write that may be applied at any time.
inline constexpr std::int64_t kNeverExpires = std::numeric_limits<std::int64_t>::max();

// One transform to be written. parent and child are indices into CommitRequest::names, and less
// than its size.
struct Row {
  std::uint32_t parent, child;
  Stamp stamp;
  Pose pose;
};

struct CommitRequest {
  std::span<const std::string_view> names;
  std::span<const Row> rows;
  std::string_view authority = {};
  bool is_static = false;
  // Drops rows that are too old, or older than all samples of a full frame. Without it, one such
  // row rejects the commit.
  bool drop_old = false;
  // The read set: the commit is rejected unless every frame still has the version that was read.
  // Version 0 asserts that the frame does not exist. read_names and read_versions are equally long.
  std::span<const std::string_view> read_names = {};
  std::span<const Version> read_versions = {};
  // The commit is rejected if it would be applied at this time of CLOCK_MONOTONIC or later. The
  // clock is read once nothing is left to wait for.
  std::int64_t expires_ns = kNeverExpires;
  // A dynamic row with a later stamp rejects the commit. With `drop_old` the row is dropped, as if
  // it were not there: it adds no name.
  Stamp max_stamp = std::numeric_limits<Stamp>::max();
};

// What a commit did with a row.
struct RowResult {
  static constexpr std::uint8_t dropped = 0;  // too old, or older than all of a full frame
  static constexpr std::uint8_t stored = 1;
  static constexpr std::uint8_t from_future = 2;  // dropped: later than CommitRequest::max_stamp
};

// Rare events of several frames (FrameEvents).
struct FrameTotals {
  std::atomic<std::uint64_t> rewritten{0}, dropped{0}, evicted{0};
};

// What a tree has, and what happened in it.
struct TreeTotals {
  std::uint64_t frames = 0, static_links = 0, samples = 0;
  std::uint64_t rewritten = 0, dropped = 0, evicted = 0;
};

class FrameAccess;
template <class Guard, class Access>
class Reader;
class CommitPlan;
class CommitExecution;
class WriteLocks;
enum class CommitScope : std::uint8_t;
enum class PlanOutcome : std::uint8_t;

class Motion;

class Tree {
 public:
  static constexpr std::size_t kNoReadLimit = static_cast<std::size_t>(-1);

  explicit Tree(const Options& options);
  Tree(const Tree&) = delete;
  Tree& operator=(const Tree&) = delete;

  // Returns the frame's id; 0 if no frame has that name.
  [[nodiscard]] FrameId find(std::string_view name) const noexcept { return names_.find(name); }
  using FrameRef = NameTable::Ref;
  // The same, so that is_current() shows after a read whether the id still belonged to the name.
  // A lookup's answer belongs to the names if their Refs were found before the lookup and are
  // current after it; if not, look the names up again. It succeeds unless one of them was removed.
  [[nodiscard]] FrameRef find_ref(std::string_view name) const noexcept {
    return names_.find_ref(name);
  }
  // Whether the id has had that name all the time since (names/table.hpp). The frame may be
  // removed, and may have come back.
  [[nodiscard]] bool is_current(FrameRef ref) const noexcept { return names_.is_current(ref); }
  // Calls read() until no id passed to another name, or authority, during the call. So all ids
  // that it reads belong to the names that it finds for them. For short reads: it costs them less
  // than is_current(), but retries whichever id has passed on. After so many attempts it takes
  // the result as it is.
  template <class Read>
  auto read_names(Read&& read, int attempts = std::numeric_limits<int>::max()) const {
    for (;;) {
      const std::uint64_t before = ids_freed_.load(std::memory_order_acquire);
      auto result = read();
      if (ids_freed_.load(std::memory_order_acquire) == before || --attempts == 0) return result;
    }
  }
  // Throws bad_alloc.
  [[nodiscard]] std::string name(FrameId id) const { return names_.name(id); }
  // Returns the name of a frame of a failure; empty if it has lost its name since. Throws
  // bad_alloc.
  [[nodiscard]] std::string name(const Failure& failure, FrameId id) const {
    std::string name = id != 0 ? names_.name(id) : std::string();
    if (failure.ids_freed != ids_freed_.load(std::memory_order_acquire)) name.clear();
    return name;
  }
  [[nodiscard]] bool removed(FrameId id) const noexcept { return names_.hidden(id); }
  [[nodiscard]] std::uint32_t size() const noexcept { return names_.size(); }
  [[nodiscard]] const Options& options() const noexcept { return options_; }

  // One query as a transaction of its own.
  void lookup(const Query& query, Answer& answer) const;
  // Each query as a transaction of its own, or together with its neighbours. Queries of one pair of
  // frames at many times then take a fraction of the time.
  void lookup_batch(std::span<const Query> queries, std::span<Answer> answers) const;
  // All queries in one transaction, at one instant. Sets `reads` to the frames that the answers
  // rest on, with their versions. Throws Rejected if more than `max_reads` frames are read, each
  // counted for every query that reads it.
  void lookup_transaction(std::span<const Query> queries, std::span<Answer> answers, ReadSet& reads,
                          std::size_t max_reads = kNoReadLimit) const;

  // Stores all rows, or throws Rejected or bad_alloc and stores none. Sets stored[i] to what it did
  // with row i (RowResult); only drop_old allows that a row is not stored. Requires stored.size()
  // >= request.rows.size().
  void commit(const CommitRequest& request, std::span<std::uint8_t> stored);

  // Reads all that the answer rests on in one transaction.
  void lookup_velocity(const VelocityQuery& query, VelocityAnswer& answer) const;
  // Copies the motion of one frame in another, in one transaction. If the lookup at one of the
  // query's times fails, `answer` has the failure, and the rest is unspecified. Throws bad_alloc.
  MotionResult lookup_motion(const MotionQuery& query, Motion& motion, Answer& answer) const;

  // Sets `frames` to those from target to source over their common ancestor.
  Failure chain(const Query& query, std::vector<FrameId>& frames) const;
  // Returns the frames from each start up to its root, each once, as of one instant. A frame's
  // parent is that of its link at a time, if it has one, else of its newest.
  [[nodiscard]] std::vector<NamedInfo> ancestors(std::span<const FrameId> starts,
                                                 Stamp stamp) const;
  // Returns the parent at a time, or of the newest sample for kNoStamp; 0 if there is none.
  [[nodiscard]] FrameId parent(FrameId frame, Stamp stamp) const;
  [[nodiscard]] FrameInfo info(FrameId frame) const;
  [[nodiscard]] const FrameEvents& events(FrameId id) const noexcept { return events_[id]; }
  // Throws bad_alloc.
  [[nodiscard]] std::string authority(AuthorityId id) const {
    return id ? authorities_.name(id) : std::string();
  }
  // The highest id of an authority so far. Not all below it need to be in use.
  [[nodiscard]] AuthorityId authorities() const noexcept { return authorities_.size(); }
  [[nodiscard]] bool forgotten(AuthorityId id) const noexcept { return authorities_.hidden(id); }
  [[nodiscard]] AuthorityCounts authority_counts(AuthorityId id) const noexcept {
    return authority_counters_.sum(id);
  }
  // How often a frame's history was cleared because time was set back.
  [[nodiscard]] std::uint64_t time_jumps() const noexcept { return time_jumps_.load(); }
  // How many rows were dropped because they were later than CommitRequest::max_stamp.
  [[nodiscard]] std::uint64_t from_future() const noexcept { return from_future_.load(); }

  // The change log; null if the tree has none.
  [[nodiscard]] ChangeLog* change_log() const noexcept { return change_log_.get(); }
  // Of a mirror (replication/change_replay.hpp): the tree's state is the original's after this
  // number.
  [[nodiscard]] Seq replayed() const noexcept { return replayed_.load(std::memory_order_acquire); }

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

  // The next three are rejected as a commit is if they expire (CommitRequest::expires_ns).

  // Drops the samples of all frames at one instant. Names stay, and static links with keep_static.
  void clear(bool keep_static, std::int64_t expires_ns = kNeverExpires);
  // Drops all frames with their links, histories and names, at one instant. Authorities and
  // counters stay. The ids pass to new names once no others are left.
  void reset(std::int64_t expires_ns = kNeverExpires);
  // Drops a frame with its link, history and name, and with `subtree` all its descendants, at one
  // instant. Throws Rejected if it is unknown, or, without `subtree`, has children.
  void remove_frame(std::string_view name, bool subtree, std::int64_t expires_ns = kNeverExpires);

  // True if a later commit could make a lookup succeed that failed so.
  [[nodiscard]] bool may_succeed_later(const Failure& failure) const noexcept;
  // Returns the oldest stamp that a frame accepts: one that is not too old, nor older than all
  // samples of a full frame. It only grows, until the history is cleared.
  [[nodiscard]] Stamp oldest_insertable(const FrameInfo& info) const noexcept;
  WaitList& wait_list() const noexcept { return wait_list_; }
  // For the wait list: counts one waiting lookup more, or less, on this frame.
  void add_waiter(FrameId frame) const noexcept {
    waiters_[frame].fetch_add(1, std::memory_order_seq_cst);
  }
  void remove_waiter(FrameId frame) const noexcept {
    waiters_[frame].fetch_sub(1, std::memory_order_seq_cst);
  }

  // The file descriptor of the tree's region, which belongs to the tree; -1 without
  // Options::shared.
  [[nodiscard]] int descriptor() const noexcept { return region_.descriptor(); }
  // Begins a lease of that length from now: until its end, readers in other processes trust what
  // they read. Requires that no other server has taken over. 0 ends the lease.
  void begin_lease(std::int64_t duration_ns) noexcept;
  // Moves the end of the lease, unless it has lapsed: then returns false, as another server may
  // have taken over. Both are for one thread at a time.
  [[nodiscard]] bool extend_lease(std::int64_t duration_ns) noexcept;

  // The bytes of all rings of samples, those that wait to be used again included.
  [[nodiscard]] std::uint64_t memory_bytes() const { return ring_arena_.bytes(); }
  [[nodiscard]] std::uint64_t commits() const noexcept { return commit_count_.sum(); }
  [[nodiscard]] Version version(FrameId frame) const noexcept {
    return frames_[frame].version.current();
  }

 private:
  friend class CommitPlan;
  friend class CommitExecution;
  friend class CommitNames;
  friend class WriteLocks;
  friend class ChangeReplay;
  friend class SnapshotReader;
  friend class InterestReader;

  template <class Guard>
  Reader<Guard, FrameAccess> reader(Guard& guard) const noexcept;
  template <class Body>
  void read(ReadSet& reads, Body&& body) const;

  bool latest_each(const Query& query, Answer& answer) const;
  std::size_t lookup_block(std::span<const Query> queries, std::span<Answer> answers) const;
  [[gnu::noinline]] void lookup_guarded(const Query& query, Answer& answer) const;

  // Gives the ids of all removed names to new ones. Requires the topology mutex, and no frame's
  // lock. Throws bad_alloc.
  void free_removed_names();
  [[nodiscard]] TreeTotals sum_totals() const noexcept;
  [[nodiscard]] bool refers_to_removed(FrameId id) const noexcept;
  void forget_removed_parents(FrameId id) noexcept;
  // Lists the removed frames that are past parents of a frame's samples, each once. Requires the
  // topology mutex and the frame's write lock. Throws bad_alloc.
  void list_removed_parents(FrameId id, std::vector<FrameId>& parents) const;
  // Makes room for a new authority: forgets those that own no frame, up to half of all, the least
  // recently used first. Requires the topology mutex. Throws bad_alloc.
  void forget_authorities();

  PlanOutcome try_commit(CommitPlan& plan, CommitExecution& execution, CommitScope scope);

  // Locks the giant mutex, if the concurrency control has one.
  [[nodiscard]] std::unique_lock<std::mutex> lock_giant() const;
  void list_frames(FrameList& all) const;
  // Leaves the frame without samples and without a parent. Requires what clear_history() does. The
  // topology index does not change.
  void clear_frame(FrameId id) noexcept;
  // Whether clear() drops the frame's samples. Requires the frame's write lock.
  [[nodiscard]] bool is_cleared(FrameId id, bool keep_static) const noexcept;
  // Fill the ticket's entry, before the first write. Require the topology mutex and the frames'
  // write locks. Throw bad_alloc.
  void log_clear(LogTicket& ticket, const WriteLocks& locks, bool keep_static) const;
  void log_removal(LogTicket& ticket, const WriteLocks& locks) const;
  void log_orphans(LogTicket& ticket, const WriteLocks& locks) const;
  // Adds the frames that had samples to `dropped`, which must have room for all. Requires the
  // topology mutex and the frames' write locks.
  void drop_samples(const FrameList& frames, bool keep_static, FrameList& dropped) noexcept;
  // Drops the frames with their names, at one instant. Requires the topology mutex. Throws
  // Rejected if it has expired, and bad_alloc.
  void drop_frames(const FrameList& frames, std::int64_t expires_ns);
  void cut_links(const FrameList& dropped) noexcept;
  void list_subtree(std::string_view name, bool subtree, FrameList& frames) const;
  // Requires that the commit which changed the frame is counted (waiting/wait_list.hpp).
  [[nodiscard]] bool has_waiters(FrameId frame) const noexcept {
    return waiters_[frame].load(std::memory_order_seq_cst) != 0;
  }
  void notify_waiters_of(const FrameList& changed) const noexcept;

  const Options options_;
  Region region_;
  Frame* const frames_;
  RingArena ring_arena_;
  FrameEvents* const events_;
  const ZeroedArray<std::atomic<std::uint32_t>> waiters_;  // by frame: how many lookups wait for it
  // By frame: how often its history was changed otherwise than by newer samples of the same parent.
  // Written under the frame's write lock.
  const ZeroedArray<std::atomic<std::uint32_t>> edits_;
  TopologyIndex topology_index_;
  AuthorityCounters authority_counters_;
  std::atomic<bool>& ever_reparented_;  // some frame once had samples of two parents
  // Counts how often ids of removed names or forgotten authorities were freed. It is incremented
  // under the topology mutex, once no frame refers to such an id, and before any passes on. Lies
  // beside words that every lookup reads, and that hardly ever change.
  std::atomic<std::uint64_t>& ids_freed_;
  NameTable names_;
  NameTable authorities_;
  Version version_base_ = 0;  // of frames with a new name; guarded by the topology mutex
  // Odd while counts pass from frames that lose their names to totals_of_freed_.
  std::atomic<std::uint64_t> moves_of_totals_{0};
  FrameTotals totals_of_freed_;
  mutable std::mutex giant_;
  mutable std::mutex topology_;
  ShardedCounter commit_count_;
  std::atomic<std::uint64_t> time_jumps_{0};
  EventLog event_log_;
  const std::unique_ptr<ChangeLog> change_log_;
  std::atomic<Seq> replayed_{0};
  std::atomic<std::uint64_t> from_future_{0};
  mutable WaitList wait_list_{*this};
};

}  // namespace ztf
