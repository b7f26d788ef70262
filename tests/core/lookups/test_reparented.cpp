// Lookups of many times after frames have moved to other parents: one chain serves them as before,
// unless the move could change their path.
#include <random>

#include "fixture.hpp"
#include "lookups/transaction.hpp"
#include "reads/motion.hpp"

using namespace ztf;

namespace {

constexpr Stamp kBegin = 100, kEnd = 200;

// map -> odom -> base -> arm -> camera, base -> lidar, and a box on a table; from kBegin to kEnd.
void fill(World& w) {
  for (Stamp t = kBegin; t <= kEnd; t += 10)
    for (const auto& [parent, child] : {std::pair{"map", "odom"},
                                        {"odom", "base"},
                                        {"base", "arm"},
                                        {"arm", "camera"},
                                        {"base", "lidar"},
                                        {"map", "table"},
                                        {"table", "box"}})
      w.set(parent, child, t, at_x(static_cast<double>(t)));
}

// How many of 64 rows one block answers, at times over the whole history.
std::size_t answered_in_one(const World& w, const char* target, const char* source) {
  std::vector<Query> queries;
  for (Stamp i = 0; i < 64; ++i)
    queries.push_back(w.query(Op::at, target, source, kBegin + i * (kEnd - kBegin) / 64));
  std::vector<Answer> answers(queries.size());
  SampleBlock block(queries, answers);
  WalkGuard guard;
  CHECK(reader_of(w.tree.state(), guard).answer_block(block));
  std::size_t answered = 0;
  for (std::size_t row = 0; row < queries.size(); ++row) answered += !block.unanswered(row);
  return answered;
}

MotionResult motion_of(const World& w, const char* fixed, const char* source) {
  Motion motion;
  Answer answer;
  const MotionResult result =
      w.tree.lookup_motion({w.id(fixed), w.id(source), kBegin, kBegin, kEnd}, motion, answer);
  CHECK_EQ(answer.failure.code, Code::ok);
  return result;
}

void check_equal(const Answer& found, const Answer& expected) {
  CHECK_EQ(found.failure.code, expected.failure.code);
  if (expected.failure.code != Code::ok) return;
  CHECK_EQ(found.stamp, expected.stamp);
  CHECK(distance(found.pose, expected.pose) < 1e-9);
}

}  // namespace

TEST(after_an_unrelated_grasp_a_block_is_answered_as_before) {
  World w;
  fill(w);
  CHECK_EQ(answered_in_one(w, "lidar", "camera"), 64u);
  w.set("camera", "box", kEnd + 1);  // the gripper takes the box
  CHECK_EQ(answered_in_one(w, "lidar", "camera"), 64u);
  CHECK_EQ(answered_in_one(w, "map", "camera"), 64u);
  CHECK(motion_of(w, "lidar", "camera") == MotionResult::copied);
  // The box's own path differs from time to time.
  w.set("camera", "box", kEnd + 2);
  CHECK_EQ(answered_in_one(w, "lidar", "box"), 0u);
  CHECK(motion_of(w, "lidar", "box") == MotionResult::varies);
}

TEST(once_the_old_parent_has_left_the_history_blocks_are_answered_again) {
  World w(Options{.cache_ns = 150});
  fill(w);
  w.set("camera", "box", kEnd + 1);
  for (Stamp t = kEnd + 10; t <= kEnd + 200; t += 10) w.set("camera", "box", t);
  CHECK_EQ(w.tree.state().frames[w.id("box")].parent_changes.load(), 0u);
  fill(w);
  for (Stamp t = kEnd; t <= kEnd + 200; t += 10)
    for (const auto& [parent, child] : {std::pair{"base", "arm"}, {"arm", "camera"}})
      w.set(parent, child, t);
  CHECK(w.tree.state().ever_reparented.load());
  w.set("table", "box", 0, {}, true);  // a static link has one parent at all times
  w.set("table", "lid", 0, {}, true);
  CHECK_EQ(answered_in_one(w, "lid", "box"), 64u);
}

// A past link above the common ancestor may lead back into the chain. Then there are two chains,
// and a block must not guess which of them a walk finds.
TEST(a_loop_above_the_common_ancestor_is_no_common_chain) {
  World w;
  const auto both = [&](const char* parent, const char* child) {
    w.set(parent, child, 100);
    w.set(parent, child, 200);
  };
  both("s", "s1"), both("b", "s"), both("a", "b"), both("a", "t");
  w.set("x", "a", 100), w.set("x", "a", 140);  // in the past, a -> x -> s
  w.set("root", "a", 150), w.set("root", "a", 200);
  both("s", "x");
  CHECK_EQ(answered_in_one(w, "t", "s1"), 0u);
}

// Random commits with parents that change, also in the past, and stamps that come late: what one
// chain answers for many times is what single lookups answer.
TEST_EACH_MODE(many_times_are_answered_like_one_by_one) {
  for (unsigned seed = 1; seed <= 60; ++seed) {
    std::mt19937 random(seed);
    const auto below = [&](unsigned bound) { return static_cast<int>(random() % bound); };
    World w(Options{.cache_ns = 60, .concurrency = c, .max_samples_per_frame = 40});
    const auto name = [](int n) { return nth("f", n); };
    const auto rare = 3 + random() % 20;
    for (int i = 0; i < 300; ++i) {
      const int child = 1 + below(7);
      const int parent = random() % rare ? (child - 1) / 2 : below(8);
      if (parent == child) continue;
      const Stamp stamp = i / 3 - (below(5) ? 0 : below(30));
      const bool is_static = below(150) == 0;
      (void)w.commit({{name(parent), name(child), stamp, some_pose(below(50))}},
                     {.is_static = is_static, .drop_old = true});
    }
    for (int target = 0; target < 8; ++target)
      for (int source = 0; source < 8; ++source) {
        std::vector<Query> queries;
        for (Stamp t = 30; t < 110; t += 1 + below(4))
          queries.push_back(w.query(Op::at, name(target), name(source), t));
        std::vector<Answer> answers(queries.size());
        w.tree.lookup_batch(queries, answers);
        for (std::size_t i = 0; i < queries.size(); ++i) {
          Answer one;
          w.tree.lookup(queries[i], one);
          check_equal(answers[i], one);
        }
        const Answer latest = w.ask(Op::latest_common, name(target), name(source));
        if (latest.failure.code == Code::ok && target != source && latest.stamp != 0)
          check_equal(latest, w.at(name(target), name(source), latest.stamp));
      }
  }
}
