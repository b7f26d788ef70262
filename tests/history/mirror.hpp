// A mirror of a tree, in the same process: a copy that a thread keeps up by the change log, as the
// mirrors of clients are by the commit stream.
//
// Thread safety: every function, from any thread, but for construction and destruction.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "replication/change_replay.hpp"
#include "replication/snapshot.hpp"
#include "tree.hpp"

namespace ztf {

class Mirror {
 public:
  // Requires that nobody writes the tree yet, and that it has a change log.
  explicit Mirror(Tree& from)
      : log_(*from.change_log()), copy_({.cache_ns = from.options().cache_ns}) {
    position_ = log_.start();
    load(from);
    follower_ = std::thread([this] { follow(); });
  }
  ~Mirror() {
    stopped_ = true;
    log_.wake();
    follower_.join();
  }
  Mirror(const Mirror&) = delete;
  Mirror& operator=(const Mirror&) = delete;

  [[nodiscard]] const Tree& tree() const noexcept { return copy_; }
  // Waits until the mirror shows every commit that ended before the call.
  void wait() const {
    const Seq seq = log_.last_drawn();
    while (copy_.replayed() < seq) std::this_thread::yield();
  }

 private:
  // A message is seldom more than a few commits, so that readers see many states.
  static constexpr std::size_t kMessageBytes = 1 << 9;

  void load(Tree& from) {
    SnapshotReader reader(from.state());
    ChangeReplay replay(copy_.state());
    const SnapshotPlan plan = reader.plan(1 << 20);
    for (std::size_t i = 1; i < plan.bounds.size(); ++i) {
      replay.load(reader.read(plan.bounds[i - 1], plan.bounds[i], 1 << 20).frames.view());
    }
  }

  void follow() {
    ChangeReplay replay(copy_.state());
    while (!stopped_) {
      log_.wait(ChangeLog::Clock::now() + std::chrono::milliseconds(100));
      const ChangeLog::Taken taken = log_.take(kMessageBytes);
      if (taken.lost) {
        std::fputs("the change log has lost entries\n", stderr);
        std::exit(EXIT_FAILURE);
      }
      if (taken.last == position_) continue;
      position_ = taken.last;
      replay.apply(changes_of(taken.entries).view(), taken.last);
    }
  }

  ChangeLog& log_;
  Tree copy_;
  Seq position_ = 0;
  std::atomic<bool> stopped_{false};
  std::thread follower_;
};

}  // namespace ztf
