// Threads that read and write a system under test for a while, and what they saw.
//
// Thread safety: one measurement at a time.
#pragma once

#include <chrono>
#include <map>

#include "system.hpp"

namespace bench {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
// Named figures; those that were not measured are left out.
using Metrics = std::map<std::string, double>;

// The time of a system's stamps. It stands still while other systems have their trials: otherwise
// a trial would begin with data as old as the other trials were long.
class PausedClock {
 public:
  [[nodiscard]] Stamp now() const { return time_ + (Clock::now() - resumed_).count(); }
  void resume() { resumed_ = Clock::now(); }
  void pause() { time_ = now(); }

 private:
  Stamp time_ = kStart + 1'000'000;
  Clock::time_point resumed_{};
};

// A system, with what its trials hand on to each other.
struct Instance {
  std::unique_ptr<System> system;
  PausedClock clock;
  Stamp next_stamp[kMaxThreads];  // of each thread's own link
};

// Own links of two threads are no neighbours.
constexpr FrameIndex own_link(unsigned thread) { return 2 * thread + 1; }

struct Trial {
  unsigned readers, writers;
  Read read;
  Draw draw;
  bool own_links;  // each writing thread sets own_link(); else random rows
  Stamp period;    // between two stamps of an own link
  double seconds;
};

// Reads and writes at full speed, each thread on a core of its own if there are enough, after a
// warm-up of a quarter of the time.
Metrics run_trial(Instance& instance, const Trial& trial);

// Reads the whole row while each link is written at a rate of its own, for some seconds;
// returns the age of the data used, link by link.
Metrics measure_staleness(Instance& instance, Read read, const std::vector<double>& rates_hz,
                          double seconds);

}  // namespace bench
