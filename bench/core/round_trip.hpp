// How far two cores are apart. Writers and readers at full speed pass cache lines to each other,
// and a virtual machine's cores may share one cache now and none a second later: a turn's figures
// are only comparable with others taken at a like distance.
//
// Thread safety: none; uses the first two cores.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>
#include <vector>

#include "cores.hpp"

namespace bench {

// Nanoseconds for a line from one core to another and back, where nobody else disturbed; NaN where
// there is one core only.
inline double round_trip_ns() {
  using Clock = std::chrono::steady_clock;
  constexpr int kBatches = 10, kTrips = 200;
  const std::vector<int> own = cores();
  if (own.size() < 2) return std::nan("");
  struct alignas(128) Line {
    std::atomic<int> value{0};
  } line;
  const auto answer = [&](int expected) {
    while (line.value.load(std::memory_order_acquire) != expected) {
    }
    line.value.store(expected + 1, std::memory_order_release);
  };
  std::thread other([&] {
    pin(own[1]);
    for (int i = 0; i < kBatches * kTrips; ++i) answer(2 * i);
  });
  double best = INFINITY;
  std::thread one([&] {
    pin(own[0]);
    for (int batch = 0, trip = 0; batch < kBatches; ++batch) {
      const auto start = Clock::now();
      for (int i = 0; i < kTrips; ++i, ++trip) answer(2 * trip + 1);
      best = std::min(best, std::chrono::duration<double, std::nano>(Clock::now() - start).count());
    }
  });
  one.join();
  other.join();
  return best / kTrips;
}

}  // namespace bench
