// Mode `2pl`: strict two-phase locking, as in the literature's baseline.
//
// Each frame has a reader-writer lock (SharedLock). A lookup takes it shared, a commit exclusive,
// and both keep their locks until they end. So nothing is validated: what a transaction has read
// stays as it is. A commit also takes the frames' SeqLocks as in the other modes, for readers of
// other processes and of single frames.
//
// Why nobody waits in a circle. A writer takes the SharedLocks of all its frames or of none, so it
// waits for none while it holds one. A reader may wait for a writer while it holds shared locks:
// that writer has all its SharedLocks, and waits only for SeqLocks, which readers hold briefly.
//
// Thread safety: every function, from any thread. A guard belongs to one thread.
#pragma once

#include <chrono>
#include <random>
#include <thread>

#include "base/retries.hpp"
#include "tree_state.hpp"

namespace ztf {

// Two-phase locking: takes a shared lock of each frame and holds it to the end. It may wait for a
// writer while it holds shared locks, because a two-phase writer that holds a SharedLock never
// waits for another one. (The writer may wait for a SeqLock, which a reader holds only briefly.)
// With `heed_wanted` it fails at a frame that a starving writer wants.
class SharedGuard : public RecordingGuard {
 public:
  SharedGuard(Frame* frames, ReadSet& reads, bool heed_wanted)
      : RecordingGuard(frames, reads), frames_(frames), heed_wanted_(heed_wanted) {}
  ~SharedGuard() {
    for (const FrameId id : held_) frames_[id].shared.unlock_shared();
  }
  SharedGuard(const SharedGuard&) = delete;
  SharedGuard& operator=(const SharedGuard&) = delete;

  bool read_version(const Frame& frame, Version& version) {
    const FrameId id = id_of(frame);
    (void)held_.reserve(1);  // allocates before the lock: every lock taken must be recorded
    Backoff backoff;
    for (;;) {
      switch (frames_[id].shared.try_lock_shared(heed_wanted_)) {
        case SharedLock::TryResult::acquired:
          held_.push_back(id);
          yield_point();
          version = frames_[id].version.current();
          return true;
        case SharedLock::TryResult::writer_wants:
          return false;
        case SharedLock::TryResult::writer_holds:
          backoff.wait();
      }
    }
  }

 private:
  Frame* const frames_;
  SmallVector<FrameId, 64> held_;
  const bool heed_wanted_;
};

struct TwoPhase {
  // Runs attempt(guard) until it returns true. A writer that starves sleeps between its attempts,
  // so a reader that has yielded to it sleeps, too: spins are too short.
  template <class Attempt>
  static void read(const TreeState& tree, ReadSet& reads, Attempt&& attempt) {
    Backoff backoff;
    for (int i = 0;; ++i) {
      {
        SharedGuard guard(tree.frames, reads, i < kHeedWantedAttempts);
        if (attempt(guard)) return;
      }
      count_retry();
      backoff.nap();
    }
  }

  // Takes the exclusive locks of all frames, or of none, and tries again after a random pause.
  // After kAttemptsBeforeWant attempts it asks new readers to stay away.
  static void lock(TreeState& tree, const FrameList& ids) {
    for (int attempt = 0;; ++attempt) {
      std::size_t taken = 0;
      while (taken < ids.size() && tree.frames[ids[taken]].shared.try_lock()) ++taken;
      if (taken == ids.size()) break;
      while (taken > 0) tree.frames[ids[--taken]].shared.unlock();
      if (attempt >= kAttemptsBeforeWant)
        for (const FrameId id : ids) tree.frames[id].shared.want();
      count_retry();
      pause(attempt);
    }
    yield_point();
  }
  static void unlock(TreeState& tree, std::span<const ReadVersion> locked) noexcept {
    for (const ReadVersion& frame : locked) tree.frames[frame.frame].shared.unlock();
  }

 private:
  // After so many attempts a reader no longer yields to a starving writer.
  static constexpr int kHeedWantedAttempts = 8;
  static constexpr int kAttemptsBeforeWant = 16;

  // Spins for a random time that grows with the attempts; later it sleeps.
  static void pause(int attempt) {
    thread_local std::minstd_rand random(
        static_cast<unsigned>(std::hash<std::thread::id>{}(std::this_thread::get_id())));
    if (attempt < 32) {
      for (auto spins = random() % (16u << std::min(attempt, 5)); spins > 0; --spins) pause_cpu();
      return;
    }
    LongWait::announce();
    std::this_thread::sleep_for(std::chrono::microseconds(1 + random() % 50));
  }
};

}  // namespace ztf
