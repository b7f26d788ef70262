// Read-only transactions of the tree, under each concurrency control. Included only by the files
// that implement the tree's reads.
//
// Thread safety: any thread, like the tree's public functions.
#pragma once

#include "reader.hpp"
#include "retries.hpp"
#include "tree.hpp"

namespace ztf {

// The length of each of two series of optimistic attempts. Tree::lookup() makes 64 with a
// WalkGuard. If all fail, or for a longer transaction, Tree::read() makes 64 with an
// OptimisticGuard. Then it locks frames (LockingGuard), which always ends.
constexpr int kOptimisticAttempts = 64;
// Two-phase locking: after so many attempts a reader no longer gives way to a starving writer.
constexpr int kHeedWantedAttempts = 8;

// Answers all queries. Returns false if the transaction must be retried. Throws Rejected if more
// than `max_reads` frames are read, and were the tree's state at one instant: a torn walk may read
// more.
template <class AnyReader>
bool answer_all(AnyReader& reader, std::span<const Query> queries, std::span<Answer> answers,
                const ReadSet& reads, std::size_t max_reads) {
  for (std::size_t i = 0; i < queries.size(); ++i) {
    if (!reader.answer(queries[i], answers[i])) return false;
    if (reads.size() > max_reads) [[unlikely]] {
      if (!reader.is_valid()) return false;
      throw Rejected{.code = Code::limit, .message = "the lookup reads too many frames"};
    }
  }
  return true;
}

// Returns a frame's parent at a time, or of the newest sample for kNoStamp; 0 if there is none.
template <class Access>
FrameId parent_of(const Access& access, const Frame& frame, Stamp stamp) noexcept {
  SampleInterval interval;
  const LinkLookup link = stamp == kNoStamp ? SelectLatest{}(access, frame, interval)
                                            : SelectAt{stamp}(access, frame, interval);
  return link.status == LinkLookup::Status::ok ? link.parent : FrameId{0};
}

inline FrameInfo info_of(const Frame& frame, const FrameEvents& events, Version version) noexcept {
  const auto acquire = std::memory_order_acquire;
  FrameInfo info;
  info.version = version;
  info.parent = frame.parent.load(acquire);
  info.authority = frame.authority.load(acquire);
  info.is_static = frame.is_static.load(acquire);
  info.samples = frame.count.load(acquire);
  info.evicted = frame.evicted.load(acquire);
  info.oldest = oldest_served_stamp(frame);
  info.newest = frame.latest.stamp.load(acquire);
  info.change = events.change.load(acquire);
  info.change_stamp = events.change_stamp.load(acquire);
  info.change_authority = events.change_authority.load(acquire);
  info.parent_before = events.parent_before.load(acquire);
  info.static_before = events.static_before.load(acquire);
  return info;
}

// Lists the frames from each start up to its root with what is known of them, each once. A frame's
// parent is that of its link at `stamp`, or of the newest one (Reader::visit_ancestors).
template <class AnyReader>
bool list_ancestors(AnyReader& reader, std::span<const FrameId> starts, Stamp stamp,
                    const FrameEvents* events, std::vector<NamedInfo>& out) {
  out.clear();
  return reader.visit_ancestors(
      starts, stamp, [&](FrameId id, const Frame& frame, FrameId parent, Version version) {
        out.push_back({id, info_of(frame, events[id], version)});
        out.back().info.parent = parent;
      });
}

template <class Guard>
ZTF_ALWAYS_INLINE Reader<Guard, FrameAccess> Tree::reader(Guard& guard) const noexcept {
  return {FrameAccess(frames_), guard, options_.max_path(), ever_reparented_, ids_freed_};
}

// Runs body(reader) until everything that it read was the tree's state at one instant. `reads` is
// then the read set. If optimistic attempts fail too often, it locks the frames.
template <class Body>
void Tree::read(ReadSet& reads, Body&& body) const {
  const auto attempt = [&](auto& guard) {
    Reader attempt_reader = reader(guard);
    return body(attempt_reader) && guard.validate_all();
  };
  switch (options_.concurrency) {
    case Concurrency::optimistic: {
      for (int i = 0; i < kOptimisticAttempts; ++i) {
        OptimisticGuard guard(frames_, reads);
        if (attempt(guard)) return;
        count_retry();
      }
      SmallVector<FrameId, 64> wanted;
      for (const ReadVersion& read : reads) wanted.push_back(read.frame);
      for (;;) {
        LockingGuard guard(frames_, reads, wanted);
        if (attempt(guard)) return;
        count_retry();
      }
    }
    case Concurrency::two_phase: {
      Backoff backoff;
      for (int i = 0;; ++i) {
        {
          SharedGuard guard(frames_, reads, i < kHeedWantedAttempts);
          if (attempt(guard)) return;
        }
        count_retry();
        backoff.nap();  // a writer that starves sleeps between its attempts: spins are too short
      }
    }
    case Concurrency::giant: {
      const auto lock = lock_announced(giant_);
      GiantGuard guard(frames_, reads);
      attempt(guard);
      return;
    }
  }
}

}  // namespace ztf
