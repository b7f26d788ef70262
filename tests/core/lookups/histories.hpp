// Histories that several tests of lookups read.
//
// Thread safety: none.
#pragma once

#include <random>

#include "fixture.hpp"

namespace ztf {

// Samples at random distances, with small and large angles between them, and quaternions of either
// sign.
inline void add_samples(World& w, std::mt19937& random, const char* parent, const char* child,
                        Stamp from, Stamp to, unsigned shortest, unsigned longest) {
  for (Stamp t = from; t <= to; t += shortest + random() % (longest - shortest + 1)) {
    Pose pose = some_pose(static_cast<int>(t % 7));
    if (t % 3 == 0)
      pose = {1e-3 * static_cast<double>(t), 0, 1, 0, 0, std::sin(t * 1e-4), std::cos(t * 1e-4)};
    if (random() % 2)
      for (double* q : {&pose.qx, &pose.qy, &pose.qz, &pose.qw}) *q = -*q;
    w.set(parent, child, t, pose);
  }
}

constexpr int kLinks = 4, kSamples = 40;
constexpr Stamp kStep = 100, kLast = (kSamples - 1) * kStep;

// The whole history of a chain f0 .. f4, whose x sum to zero at all times: whole numbers, and all
// links have samples at the same times.
inline std::vector<Set> zero_sums(std::mt19937& random) {
  std::vector<Set> sets;
  for (int sample = 0; sample < kSamples; ++sample) {
    int sum = 0;
    for (int i = 1; i <= kLinks; ++i) {
      const int x = i < kLinks ? static_cast<int>(random() % 2001) - 1000 : -sum;
      sum += x;
      sets.push_back({nth("f", i - 1), nth("f", i), sample * kStep, at_x(x)});
    }
  }
  return sets;
}

}  // namespace ztf
