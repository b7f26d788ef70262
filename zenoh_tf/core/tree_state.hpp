// What a tree consists of: its frames, names, rings, counters, logs and waiting lookups.
//
// The folders above work on it: modes/, shared/, lookups/, commits/ and replication/. Everybody
// else uses the Tree (tree.hpp), which has this as its base. Needs a 64-bit target
// (records/frame.hpp).
//
// Thread safety: every function, from any thread. A member that says nothing else is of a type that
// is safe by itself.
// Lock order, of the whole core. A thread takes a lock only while it holds none of a later line:
//   replication/interest_reader.hpp  the reader's mutex: around a whole read of the interest
//   tree_state.hpp                   the giant mutex: around each transaction in mode giant
//   tree_state.hpp                   the topology mutex: names are added, newest parents change
//   waiting/wait_list.hpp            the list's mutex: its holder may lock one frame for a moment
//   records/lock_words.hpp           the frames' locks, in ascending order of ids
//   records/ring_arena.hpp           the arena's mutex: a ring doubles
//   records/region.hpp               the region's mutex: arena or table of names takes a block
// Leaves, whose holders take no other lock: the mutexes of records/event_log.hpp, of
// records/change_log.hpp, of a BlockingWaiter (lookups/park.hpp), of shared/lease.hpp, and of
// estimates/cache.hpp and estimates/limits.hpp.
// Lookups take none of the mutexes but the giant one; estimates also take the leaves of estimates/,
// and lookups that wait the list's. A lookup that retries too often takes the frames' locks.
// Readers of mode 2pl share the frames' locks in the order of their walk (modes/two_phase.hpp says
// why that is no deadlock).
//
// States of a name. Each row is reached from the one before, and the last one is as a new name:
//
//   state    find()  id           frame                       leaves the state
//   live     the id  its own      as commits have written it  remove_frame(), reset()
//   removed  0       its own yet  empty, its version counts   to live by a commit of the name; to
//                                                             freed when ids run out
//   freed    0       any name may has a new version, and no   to live by a commit of the name, with
//                    get it       sample refers to it         another id
// commits/remove.cpp removes names, commits/freed_names.cpp frees all removed ones at once, and
// commits/names.hpp makes names live. Authorities are live or freed (free_authorities()).
//
// Invariants:
//
// 1. Frames are never freed or moved: an id stays valid for the tree's life. It may pass from a
//    freed name to a new one, which is_current() notices.
// 2. The newest parents form a forest. A commit that changes one, or adds a name, holds the
//    topology mutex and has checked that no cycle closes.
// 3. A rejected commit leaves nothing behind, not even a name, but for two things: the marks of
//    late samples (FrameEvents), and ids that were freed to make room (see above).
// 4. The versions of a name only grow, also if it comes back under another id.
#pragma once

#include <limits>
#include <memory>
#include <mutex>
#include <span>
#include <string>

#include "base/options.hpp"
#include "names/table.hpp"
#include "reads/frame_reads.hpp"
#include "records/change_log.hpp"
#include "records/counters.hpp"
#include "records/event_log.hpp"
#include "records/frame_info.hpp"
#include "records/layout.hpp"
#include "records/region.hpp"
#include "system/zeroed_array.hpp"
#include "waiting/wait_list.hpp"

namespace ztf {

struct TreeState {
  explicit TreeState(const Options& options);
  TreeState(const TreeState&) = delete;
  TreeState& operator=(const TreeState&) = delete;

  // Returns a frame's version, with SeqLock::kWriting while a write is in progress.
  [[nodiscard]] Version version(FrameId frame) const noexcept {
    return frames[frame].version.current();
  }
  [[nodiscard]] bool removed(FrameId id) const noexcept { return names.removed(id); }
  // Throws bad_alloc, as does authority().
  [[nodiscard]] std::string name(FrameId id) const { return names.name(id); }
  [[nodiscard]] std::string authority(AuthorityId id) const {
    return id ? authorities.name(id) : std::string();
  }
  [[nodiscard]] FrameInfo info(FrameId id) const { return read_info(frames[id], events[id]); }
  void list_frames(FrameList& all) const {
    for (FrameId id = 1; id <= names.size(); ++id) all.push_back(id);
  }
  // Calls read() until no id passed to another name, or authority, during the call. So all ids
  // that it reads belong to the names that it finds for them. For short reads: it costs them less
  // than is_current(), but retries whichever id has passed on. After so many attempts it returns
  // the result all the same.
  template <class Read>
  auto read_names(Read&& read, int attempts = std::numeric_limits<int>::max()) const {
    for (;;) {
      const std::uint64_t before = ids_freed.load(std::memory_order_acquire);
      auto result = read();
      if (ids_freed.load(std::memory_order_acquire) == before || --attempts == 0) return result;
    }
  }

  // Forgets what is known of frames beside their samples, as they are removed. What they had
  // counted passes to totals_of_removed. Requires the topology mutex and the frames' write locks.
  void forget_events(std::span<const FrameId> removed) noexcept;

  // Begins a lease of that length from now: until its end, readers in other processes trust what
  // they read. Requires that no other server has taken over. 0 ends the lease. For one thread at a
  // time.
  void begin_lease(std::int64_t duration_ns) noexcept;

  // The server started `startup.elapsed_ns` ago. For one thread at a time.
  void begin_startup(Startup startup) noexcept;
  [[nodiscard]] Startup startup() const noexcept;

  const Options options;
  Region region;
  Frame* const frames;
  RingArena ring_arena;
  FrameEvents* const events;
  // By frame: how often its history was changed otherwise than by newer samples of the same parent.
  // Written under the frame's write lock.
  const ZeroedArray<std::atomic<std::uint32_t>> edits;
  AuthorityCounters authority_counters;
  std::atomic<bool>& ever_reparented;  // some frame once had samples of two parents
  // Counts how often ids of removed names or authorities were freed. It is incremented
  // under the topology mutex, once no frame refers to such an id, and before any passes on. Lies
  // beside words that every lookup reads, and that hardly ever change.
  std::atomic<std::uint64_t>& ids_freed;
  NameTable names;
  NameTable authorities;
  Version version_base = 0;  // of frames with a new name; guarded by the topology mutex
  // What removed frames had counted. `moves` is odd while counts pass from them to these.
  struct {
    std::atomic<std::uint64_t> moves{0}, rewritten{0}, dropped{0}, evicted{0};
  } totals_of_removed;
  mutable std::mutex giant;
  mutable std::mutex topology;
  ShardedCounter commit_count;
  std::atomic<std::uint64_t> time_jumps{0};
  std::atomic<std::uint64_t> from_future{0};
  EventLog event_log;
  const std::unique_ptr<ChangeLog> change_log;  // null if the tree has none
  std::atomic<Seq> replayed{0};
  mutable WaitList wait_list;
};

}  // namespace ztf
