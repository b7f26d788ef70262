// What is known about a frame beside its samples.
//
// Thread safety: FrameEvents are written under the frame's write lock, and may be read at any time,
// each word by itself. A FrameInfo is a value, read at one instant.
#pragma once

#include <atomic>
#include <cstdint>

#include "records/counters.hpp"
#include "records/frame.hpp"

namespace ztf {

// How often rare events happened to a frame, and the last one that changed its link. The counters
// never go back until the frame is removed: 64 bits do not wrap.
struct FrameEvents {
  enum class Change : std::uint8_t {
    none,
    reparented,  // the newest sample has another parent
    switched,    // between static and dynamic
    authority,   // another authority writes the frame
  };

  std::atomic<std::uint64_t> rewritten;   // samples replaced at their stamp
  std::atomic<std::uint64_t> dropped;     // rows too old, or older than all of a full frame
  std::atomic<std::uint64_t> reparented;  // changes of the link, by kind
  std::atomic<std::uint64_t> switched;
  std::atomic<std::uint64_t> authority_changes;
  std::atomic<std::uint64_t> time_jumps;  // the history was cleared, as time was set back

  // Lookups that asked the link for a time before its sample had come (lookups/late.hpp): those
  // that failed, those that got their answer after they had waited, and by how much the times that
  // they asked for were newer than the newest sample, in sum. Written by readers, without a lock.
  std::atomic<std::uint64_t> late_failures, late_waits, late_ns;

  // The last time that a static link's value was replaced by another one: how often until then,
  // when by the real-time clock, how far the child moved and turned, and whose value it was.
  std::atomic<std::uint64_t> replaced;
  std::atomic<std::int64_t> replaced_at_ns;
  std::atomic<float> replaced_m, replaced_rad;
  std::atomic<AuthorityId> replaced_authority;

  // The last time jump: when, or 0 if there was none since the link was cleared, the newest stamp
  // before it, and whether it led to later stamps.
  std::atomic<std::int64_t> jumped_at_ns;
  std::atomic<Stamp> jumped_from;
  std::atomic<bool> jumped_ahead;

  // The rows since the last stored one that were far from the frame's stamps, and followed one
  // another (commits/time_jumps.cpp): the frame's version then, their stamps, how many they were.
  std::atomic<Version> run_version;
  std::atomic<Stamp> run_first, run_last;
  std::atomic<std::uint32_t> run_rows, run_commits;
  // How far apart samples are that come by more than the cache time after one another; 0: unknown.
  std::atomic<std::uint64_t> usual_gap_ns;

  // The last change of the link, and what the link was before. The pose is the newest one.
  std::atomic<Stamp> change_stamp;  // of the row that made the change
  std::atomic<AuthorityId> change_authority;
  std::atomic<AuthorityId> authority_before;
  AtomicPose pose_before;
  std::atomic<FrameId> parent_before;
  std::atomic<bool> static_before;
  std::atomic<Change> change;

  // Forgets the last replacement and time jump, which are the link's, but no counter. Requires the
  // frame's write lock.
  void forget_link() noexcept {
    replaced_at_ns.store(0, std::memory_order_release);
    jumped_at_ns.store(0, std::memory_order_release);
    jumped_ahead.store(false, std::memory_order_release);
    usual_gap_ns.store(0, std::memory_order_release);
  }

  // Forgets the lookups for which the link was late.
  void forget_lookups() noexcept {
    for (auto* counter : {&late_failures, &late_waits, &late_ns})
      counter->store(0, std::memory_order_release);
  }

  // Forgets everything, as the frame is removed. Requires the frame's write lock.
  void reset() noexcept {
    const auto release = std::memory_order_release;
    for (auto* counter :
         {&rewritten, &dropped, &reparented, &switched, &authority_changes, &time_jumps, &replaced})
      counter->store(0, release);
    forget_lookups();
    forget_link();
    run_last.store(0, release);
    run_version.store(0, release);
    change_stamp.store(0, release);
    change_authority.store(0, release);
    authority_before.store(0, release);
    parent_before.store(0, release);
    static_before.store(false, release);
    change.store(Change::none, release);
  }
};

struct FrameInfo {
  FrameId parent;         // of the newest sample; 0: a root
  AuthorityId authority;  // of the last commit to the frame
  bool is_static;
  std::uint32_t samples;  // in the history; 0 for a static frame
  std::uint64_t evicted;  // samples dropped because the frame was full
  Stamp oldest, newest;   // both a static frame's stamp; unspecified for a root
  Version version;

  // As in FrameEvents.
  FrameEvents::Change change;
  Stamp change_stamp;
  AuthorityId change_authority, authority_before;
  FrameId parent_before;
  bool static_before;
  Pose pose_before;
};

struct NamedInfo {
  FrameId id;
  FrameInfo info;
};

}  // namespace ztf
