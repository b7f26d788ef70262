// Threads that read and write a store at full speed, and what they saw.
//
// Thread safety: one crowd at a time.
#pragma once

#include <chrono>
#include <vector>

#include "histogram.hpp"
#include "store.hpp"

namespace bench {

// The time of a store's stamps. It stands still while other stores are measured: else a turn would
// begin with data as old as the others' turns were long, and with samples that no link shares.
class PausedClock {
 public:
  [[nodiscard]] Stamp now() const { return begin_ + since(resumed_); }
  void resume() { resumed_ = Clock::now(); }
  void pause() { begin_ = now(); }

 private:
  using Clock = std::chrono::steady_clock;
  static Stamp since(Clock::time_point start) {
    return std::chrono::nanoseconds(Clock::now() - start).count();
  }

  Stamp begin_ = kStart + 1'000'000;
  Clock::time_point resumed_{};
};

struct Load {
  unsigned readers, writers;
  Read kind;
  // What is read: any of these pairs or, where there are none, any `length` links in a row of the
  // snake of that many. Writers always set links of the snake.
  std::vector<Pair> pairs;
  FrameIndex links;
  unsigned length;
};

struct Turn {
  double seconds = 0;
  double others_cores = 0;   // used by other programs meanwhile
  double round_trip_ns = 0;  // of a cache line between two cores, right after
  std::uint64_t reads = 0, writes = 0, links_written = 0;
  std::uint64_t unanswered = 0;                         // reads that are not in `reads`
  std::uint64_t read_restarts = 0, write_restarts = 0;  // not of tf2, which never starts over
  Histogram read_ns, write_ns;
  // Time of the call less the stamp of the data, summed over some reads.
  double oldest_s = 0, mean_s = 0;
  std::uint64_t delays = 0;
};

// Whether threads are pinned, each to a core of its own: where there are enough.
bool pinned(unsigned threads);

Turn run_crowd(Store& store, const Load& load, PausedClock& clock, double warm_up_s,
               double seconds);

}  // namespace bench
