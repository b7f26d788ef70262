// Velocities against writers: one of the tree's states, never a mixture of two.
#include <random>

#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

// All of the history of two links is rewritten by each commit, with other places but the same
// motion: from 0 to 100 ns `leaf` moves by 3 in `root`, by 1 in `mid`, whole numbers all.
std::vector<Set> same_motion(std::mt19937& random) {
  const int a = static_cast<int>(random() % 2001) - 1000, b = static_cast<int>(random() % 2001);
  return {{"root", "mid", 0, at_x(a)},
          {"root", "mid", 100, at_x(a + 2)},
          {"mid", "leaf", 0, at_x(b)},
          {"mid", "leaf", 100, at_x(b + 1)}};
}

}  // namespace

TEST_EACH_MODE(a_velocity_is_of_one_state) {
  World w(c);
  std::mt19937 random(1);
  w.accept(same_motion(random));
  std::atomic<int> commits{0};
  ThreadGroup threads;
  threads.background(2, [&](int i, const auto& stop) {
    std::mt19937 own(i + 2);
    for (; !stop; ++commits) w.accept(same_motion(own));
  });
  threads.foreground(2, [&](int thread) {
    for (int i = 0; i < 400 || commits < 200; ++i) {
      const auto root = w.id("root"), leaf = w.id("leaf");
      const bool crossed = (i + thread) % 2;
      VelocityAnswer a;
      w.tree.lookup_velocity({crossed ? root : leaf,
                              crossed ? leaf : root,
                              w.id("mid"),
                              w.id("mid"),
                              kNoStamp,
                              100,
                              {0, 0, 0}},
                             a);
      CHECK_EQ(a.failure.code, Code::ok);
      CHECK_EQ(a.stamp, 100);
      CHECK_EQ(a.start, 0);
      CHECK_NEAR(a.twist.linear.x * 100e-9, crossed ? -3 : 3, 1e-9);
    }
  });
  threads.join();
  CHECK(commits >= 200);
}
