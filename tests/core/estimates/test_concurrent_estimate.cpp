// Estimates against writers: of one state of the tree, with bounds that belong to its motion.
#include <random>

#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr Stamp kStep = 10'000'000;

struct Estimated : EstimateAnswer {
  Estimated(const World& w, Stamp stamp, double level = 0.9) : EstimateAnswer{} {
    w.tree.estimate({w.id("map"), w.id("tool"), stamp, kNoStamp, level, 500'000'000, 0}, *this);
  }
};

// Both links move by 1 m/s, in opposite directions: the tool stands still at `place`.
std::vector<Set> opposite(Stamp stamp, double place) {
  const double x = static_cast<double>(stamp % 1'000'000'000'000) * 1e-9;
  return {{"map", "base", stamp, at_x(place + x)}, {"base", "tool", stamp, at_x(-x)}};
}

}  // namespace

TEST_EACH_MODE(an_estimate_is_of_one_state) {
  World w(c);
  std::atomic<Stamp> newest{0};
  for (; newest < 3'000'000'000; newest += kStep) w.accept(opposite(newest, 5));
  std::atomic<int> commits{0};
  ThreadGroup threads;
  threads.background(1, [&](int, const auto& stop) {
    for (; !stop; ++commits) w.accept(opposite(newest += kStep, 5));
  });
  threads.foreground(2, [&](int thread) {
    for (int i = 0; i < 200 || commits < 200; ++i) {
      const Estimated a(w, newest + (i % 7) * kStep, thread ? 0.9 : 0.8);
      // The writer may have been faster than the cache time.
      if (a.failure.code == Code::forward || a.failure.code == Code::backward) continue;
      CHECK_EQ(a.failure.code, Code::ok);
      CHECK_NEAR(a.pose.x, 5, 1e-6);
      CHECK(a.metres < 1e-6 && a.radians < 1e-6);
      CHECK(a.level > 0.7);
    }
  });
  threads.join();
  CHECK(commits >= 200);
}

TEST_EACH_MODE(an_edited_history_is_backtested_again) {
  World w(c);
  for (Stamp stamp = 0; stamp < 3'000'000'000; stamp += kStep) w.accept(opposite(stamp, 5));
  const Stamp ahead = 3'000'000'000 + kStep;
  CHECK(Estimated(w, ahead).metres < 1e-6);
  for (Stamp stamp = 0; stamp < 2'900'000'000; stamp += kStep)
    w.accept({{"map", "base", stamp, at_x(static_cast<double>(stamp / kStep % 3))}});
  CHECK(Estimated(w, ahead).metres > 0.5);
  w.tree.clear(false);
  w.accept(opposite(0, 5));
  CHECK(std::isinf(Estimated(w, kStep).metres));
}

TEST(the_cache_is_bounded) {
  World w;
  for (Stamp stamp = 0; stamp < 2'000'000'000; stamp += kStep)
    for (int i = 0; i < 400; ++i)
      w.accept({{"map", nth("f", i), stamp, at_x(static_cast<double>(stamp) * 1e-9)}});
  for (int i = 0; i < 400; ++i) {
    EstimateAnswer a;
    w.tree.estimate({w.id("map"), w.id(nth("f", i)), 2'000'000'000, kNoStamp, 0.9, kStep, 0}, a);
    CHECK_NEAR(a.metres, 0, 1e-6);
  }
  CHECK_EQ(w.tree.estimate_cache().size(), EstimateCache::kMostEntries);
}
