// Threads that read and write a system under test for a while, and what they saw.
//
// Thread safety: one measurement at a time.
#pragma once

#include <chrono>
#include <map>

#include "system.hpp"

namespace bench {

using Clock = std::chrono::steady_clock;
// Named figures; those that were not measured are left out.
using Metrics = std::map<std::string, double>;

// A system, with what its trials hand on to each other.
struct Instance {
  std::unique_ptr<System> system;
  Stamp next_stamp[kMaxThreads];  // of each thread's own link

  // The time of the stamps stands still while other systems have their trials: otherwise a trial
  // would begin with data as old as the other trials were long.
  [[nodiscard]] Stamp now() const { return paused_at_ + (Clock::now() - resumed_).count(); }
  void resume() { resumed_ = Clock::now(); }
  void pause() { paused_at_ = now(); }

 private:
  Stamp paused_at_ = kStart + 1'000'000;
  Clock::time_point resumed_{};
};

struct Trial {
  unsigned readers, writers;
  Read read;
  Draw draw;
  bool own_links;  // each writing thread sets a link of its own; else random rows
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
