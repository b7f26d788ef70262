// The transform tree: every frame's record, the names, and the two kinds of
// transactions, reads and commits.
//
// Thread safety: everything, from any thread.
// Lock order: giant mutex (giant only), topology mutex, then frames in
// ascending id, then that of the rings' memory. Reads take none of these mutexes but the giant one.
// Invariants
// 1. Frames are never freed or moved; an id stays good for the tree's life.
// 2. The newest parents form a forest: whoever changes a parent, or adds a
//    name, holds the topology mutex and has shown that no cycle closes.
// 3. A refused commit leaves nothing behind, not even a name.
#pragma once

#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "counters.hpp"
#include "frame_info.hpp"
#include "guards.hpp"
#include "history.hpp"
#include "name_table.hpp"
#include "query.hpp"
#include "velocity.hpp"
#include "wait_list.hpp"
#include "zeroed_array.hpp"

namespace ztf {

struct Options {
  std::uint64_t cache_ns = 10'000'000'000;
  Concurrency concurrency = Concurrency::optimistic;
  std::uint32_t max_frames = 1u << 20;
  std::uint32_t max_samples_per_frame = 1u << 16;
  std::uint32_t max_name_bytes = 255;
  std::uint32_t max_depth = 1000;
  std::uint32_t max_authorities = 4096;
  bool one_authority_per_frame = false;
  // A dynamic row that is too old for its frame means that time was set back:
  // drop all samples and store it, instead of dropping or refusing the row.
  bool clear_on_time_jump = false;
};

// One transform to be written; parent and child are rows of CommitRequest::names.
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
  bool drop_old = false;  // else a row that is too old refuses the commit
  // What the transaction has read; each version must still stand.
  std::span<const std::string_view> read_names = {};
  std::span<const Version> read_versions = {};
};

// Why a commit was refused, or a question cannot be asked.
struct Rejected {
  Code code;
  std::string message;
  std::string frame = {}, parent = {}, field = {};
  Stamp stamp = kNoStamp, oldest = kNoStamp, newest = kNoStamp;
  std::int64_t limit = -1, value = -1;
};

template <class Guard>
class Reader;

class Tree {
 public:
  explicit Tree(const Options& options);
  Tree(const Tree&) = delete;
  Tree& operator=(const Tree&) = delete;

  // 0 where there is no such frame.
  [[nodiscard]] FrameId find(std::string_view name) const noexcept { return names_.find(name); }
  [[nodiscard]] std::string_view name(FrameId id) const noexcept { return names_.name(id); }
  [[nodiscard]] bool removed(FrameId id) const noexcept { return names_.hidden(id); }
  [[nodiscard]] std::uint32_t size() const noexcept { return names_.size(); }
  [[nodiscard]] const Options& options() const noexcept { return options_; }

  // One query as a transaction of its own.
  void lookup(const Query& query, Answer& answer) const;
  // Each query as a transaction of its own, or together with its neighbours: one
  // pair of frames at many times takes a fraction of the time.
  void lookup_batch(std::span<const Query> queries, std::span<Answer> answers) const;
  // All queries in one transaction: one instant for all. `reads`: what they rest on.
  void lookup_transaction(std::span<const Query> queries, std::span<Answer> answers,
                          ReadSet& reads) const;

  // All rows or none; throws Rejected. stored[i] tells which rows were not too old.
  void commit(const CommitRequest& request, std::span<std::uint8_t> stored);

  // All that the answer rests on is read in one transaction.
  void lookup_velocity(const VelocityQuery& query, VelocityAnswer& answer) const;

  // The frames from target to source over their common ancestor.
  Failure chain(const Query& query, std::vector<FrameId>& frames) const;
  // 0: no parent at that time; kNoStamp: the newest.
  [[nodiscard]] FrameId parent(FrameId frame, Stamp stamp) const;
  [[nodiscard]] FrameInfo info(FrameId frame) const;
  [[nodiscard]] const FrameEvents& events(FrameId id) const noexcept { return events_[id]; }
  [[nodiscard]] std::string_view authority(AuthorityId id) const noexcept {
    return id ? authorities_.name(id) : std::string_view();
  }
  [[nodiscard]] AuthorityId authorities() const noexcept { return authorities_.size(); }
  [[nodiscard]] AuthorityCounts authority_counts(AuthorityId id) const noexcept {
    return authority_counters_.sum(id);
  }
  // How often samples were dropped because time was set back.
  [[nodiscard]] std::uint64_t time_jumps() const noexcept { return time_jumps_.load(); }

  // Drops samples, at one instant; names and, if asked for, static links stay.
  void clear(bool keep_static);
  // Drops all frames with their links, histories and names, at one instant.
  // Authorities and counters stay, and so do the ids of names: a name that comes
  // back takes its id again, any other counts against the limit of frames.
  void reset();
  // Drops a frame with its link, history and name, or with `subtree` all that
  // stand on it, at one instant. Throws Rejected: unknown, or a parent of others.
  void remove_frame(std::string_view name, bool subtree);

  // Whether an answer that failed so could come with a later commit.
  [[nodiscard]] bool may_succeed_later(const Failure& failure) const noexcept;
  // The oldest stamp that is not too old for a frame with this newest one.
  [[nodiscard]] Stamp oldest_possible(Stamp newest) const noexcept;
  WaitList& wait_list() const noexcept { return wait_list_; }
  void mark_waited(FrameId frame, bool more) const noexcept {
    waiters_[frame].fetch_add(more ? 1u : ~0u, std::memory_order_seq_cst);
  }

  [[nodiscard]] std::uint64_t commits() const noexcept { return count_.sum(); }
  [[nodiscard]] Version version(FrameId frame) const noexcept {
    return frames_[frame].version.load();
  }

 private:
  friend class Commit;
  friend class CommitNames;
  friend class WriteLocks;

  template <class Guard>
  Reader<Guard> reader(Guard& guard) const noexcept;
  template <class Body>
  void read(ReadSet& reads, Body&& body) const;

  bool latest_each(const Query& query, Answer& answer) const;
  std::size_t sample(std::span<const Query> queries, std::span<Answer> answers) const;
  [[gnu::noinline]] void lookup_guarded(const Query& query, Answer& answer) const;

  void list_frames(FrameList& all) const;
  // For who holds all these frames; those that had samples are added to `dropped`, which has list.
  void drop_samples(const FrameList& frames, bool keep_static, FrameList& dropped) noexcept;
  // Drops the frames with their names. Requires the topology mutex and, after
  // begin_write(), the write locks of all of them.
  void drop_frames(const FrameList& frames) noexcept;
  // Once the commit that changed them is counted.
  [[nodiscard]] bool has_waiters(FrameId frame) const noexcept {
    return waiters_[frame].load(std::memory_order_seq_cst) != 0;
  }
  void notify_waiters_of(const FrameList& changed) const;

  const Options options_;
  const ZeroedArray<Frame> frame_array_;
  Frame* const frames_;
  RingArena ring_arena_;
  const ZeroedArray<FrameEvents> events_;
  const ZeroedArray<std::atomic<std::uint32_t>>
      waiters_;  // lookups that wait for a commit on a frame
  AuthorityCounters authority_counters_;
  std::atomic<bool> ever_reparented_{false};  // some frame's, within its history, ever
  NameTable names_;
  NameTable authorities_;
  mutable std::mutex giant_;
  std::mutex topology_;
  ShardedCounter count_;
  std::atomic<std::uint64_t> time_jumps_{0};
  mutable WaitList wait_list_{*this};
};

}  // namespace ztf
