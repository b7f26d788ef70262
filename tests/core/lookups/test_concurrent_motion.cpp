// Motions that are copied while others write: all poses are of one commit.
#include "lookups/histories.hpp"
#include "reads/motion.hpp"
#include "shared/shared_tree.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

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

TEST_EACH_MODE(a_motion_never_mixes_commits) {
  World w(Options{.concurrency = c, .max_memory_bytes = 1 << 24, .shared = true});
  std::mt19937 random(1);
  w.accept(zero_sums(random));
  w.tree.begin_lease(3'600'000'000'000);
  const SharedTree mapped(w.tree.descriptor());
  std::atomic<int> commits{0}, answered{0};
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    std::mt19937 own(2);
    for (; !stop; ++commits) {
      w.accept(zero_sums(own));
      std::this_thread::yield();
    }
  });
  threads.foreground(2, [&](int thread) {
    std::mt19937 own(thread + 10);
    for (int i = 0; i < 200 || commits < 100; ++i)
      answered += thread ? check_still(w.tree, own) : check_still(mapped, own);
  });
  threads.join();
  CHECK(answered >= 200);
}
