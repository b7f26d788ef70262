// Motions that are copied while others write: all poses are of one commit.
#include <random>

#include "fixture.hpp"
#include "reads/motion.hpp"
#include "shared/shared_tree.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr int kLinks = 4, kSamples = 40;
constexpr Stamp kStep = 100, kLast = (kSamples - 1) * kStep;

// The whole history of a chain f0 .. f4. The x of its links sum to zero at all times, as all links
// have samples at the same times.
std::vector<Set> zero_sums(std::mt19937& random) {
  std::vector<Set> sets;
  for (int sample = 0; sample < kSamples; ++sample) {
    int sum = 0;
    for (int i = 1; i <= kLinks; ++i) {
      const int x = i < kLinks ? static_cast<int>(random() % 2001) - 1000 : -sum;
      sum += x;
      sets.push_back(
          {"f" + std::to_string(i - 1), "f" + std::to_string(i), sample * kStep, at_x(x)});
    }
  }
  return sets;
}

// Copies motions of parts of the history and checks that nothing moves. Returns whether it could:
// a reader of another process may give up.
template <class AnyTree>
bool check_still(const AnyTree& tree, std::mt19937& random) {
  const bool crossed = random() % 2;
  const FrameId first = tree.find("f0"), last = tree.find("f4");
  Stamp times[4];
  for (Stamp& time : times) time = static_cast<Stamp>(random() % (kLast + 1));
  const auto [low, high] = std::minmax(times[0], times[1]);
  const MotionQuery query{crossed ? last : first, crossed ? first : last, times[2], low, high};
  Motion motion;
  Answer answer;
  try {
    CHECK(tree.lookup_motion(query, motion, answer) == MotionResult::copied);
  } catch (const Unanswered&) {
    return false;
  }
  CHECK_EQ(answer.failure.code, Code::ok);
  motion.fix_at(query.at);
  for (Stamp& time : times) time = low + static_cast<Stamp>(random()) % (high - low + 1);
  PointMap maps[4];
  motion.compute(times, maps);
  for (const PointMap& map : maps) CHECK_NEAR(map.c[3][0], 0, 1e-9);
  return true;
}

}  // namespace

TEST(a_motion_never_mixes_commits) {
  for_each_concurrency([](Concurrency c) {
    World w(Options{.concurrency = c, .max_memory_bytes = 1 << 24, .shared = true});
    std::mt19937 random(1);
    CHECK_EQ(w.refusal(zero_sums(random)), Code::ok);
    w.tree.begin_lease(3'600'000'000'000);
    const SharedTree mapped(w.tree.descriptor());
    std::atomic<int> commits{0}, answered{0};
    ThreadGroup threads;
    threads.background([&](const auto& stop) {
      std::mt19937 own(2);
      for (; !stop; ++commits) {
        CHECK_EQ(w.refusal(zero_sums(own)), Code::ok);
        std::this_thread::yield();
      }
    });
    for (unsigned thread = 0; thread < 2; ++thread)
      threads.foreground([&, thread] {
        std::mt19937 own(thread + 10);
        for (int i = 0; i < 200 || commits < 100; ++i)
          answered += thread ? check_still(w.tree, own) : check_still(mapped, own);
      });
    threads.join();
    CHECK(answered >= 200);
  });
}
