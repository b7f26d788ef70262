// Which links a lookup follows and what it computes from them. No pose has a symmetry that could
// hide an error.
#include "fixture.hpp"

using namespace ztf;

namespace {

// A chain of links below `root`: prefix1, prefix2, ...; returns the pose of the last in root.
Pose grow(World& w, const std::string& root, const std::string& prefix, int links,
          Stamp stamp = 1) {
  std::vector<Set> sets;
  Pose product;
  for (int i = 1; i <= links; ++i) {
    sets.push_back({i == 1 ? root : nth(prefix, i - 1), nth(prefix, i), stamp, some_pose(i % 17)});
    product = product * some_pose(i % 17);
  }
  w.accept(sets);
  return product;
}

void check_pose(const World& w, const std::string& target, const std::string& source,
                const Pose& expected, Stamp stamp = 1, double within = 1e-8) {
  for (const Op op : {Op::at, Op::latest_common, Op::latest, Op::latest_xact}) {
    const Answer a = w.ask(op, target, source, stamp);
    CHECK_EQ(a.failure.code, Code::ok);
    CHECK_NEAR(distance(a.pose, expected), 0, within);
    CHECK_EQ(a.stamp, stamp);
  }
  CHECK_EQ(w.ask(Op::common_time, target, source).stamp, stamp);
}

}  // namespace

TEST_EACH_MODE(ancestors_descendants_and_cousins) {
  World w(c);
  // a - b - c, b - d - e, a - f
  w.set("a", "b", 1, some_pose(1));
  w.set("b", "c", 1, some_pose(2));
  w.set("b", "d", 1, some_pose(3));
  w.set("d", "e", 1, some_pose(4));
  w.set("a", "f", 1, some_pose(5));
  const std::vector<std::pair<std::string, Pose>> in_a = {
      {"a", {}},
      {"b", some_pose(1)},
      {"c", some_pose(1) * some_pose(2)},
      {"d", some_pose(1) * some_pose(3)},
      {"e", some_pose(1) * some_pose(3) * some_pose(4)},
      {"f", some_pose(5)}};
  for (const auto& [target, x_a_target] : in_a)
    for (const auto& [source, x_a_source] : in_a) {
      const Pose expected = inverse(x_a_target) * x_a_source;
      if (target != source || target != "a") check_pose(w, target, source, expected, 1, 1e-13);
    }
  CHECK_EQ(w.ask(Op::latest_common, "c", "c").stamp, 1);
  CHECK_EQ(w.ask(Op::latest_common, "a", "a").stamp, 0);
}

// Path lengths around each limit of Walker: 16 direct links, 48 near ones, 64 far ones.
TEST_EACH_MODE(common_ancestors_near_and_far) {
  for (const int left : {1, 15, 16, 17, 47, 48, 49, 63, 64, 65, 66, 150})
    for (const int right : {0, 1, 16, 49, 64, 65, 113, 180}) {
      World w(c);
      grow(w, "top", "stem", 30);
      const Pose x_left = grow(w, "stem30", "l", left);
      const Pose x_right = right ? grow(w, "stem30", "r", right) : Pose{};
      const std::string r = right ? nth("r", right) : "stem30";
      check_pose(w, nth("l", left), r, inverse(x_left) * x_right);
      check_pose(w, r, nth("l", left), inverse(x_right) * x_left);
      std::vector<FrameId> chain;
      CHECK_EQ(w.tree.chain(w.query(Op::at, r, nth("l", left)), chain).code, Code::ok);
      CHECK_EQ(chain.size(), static_cast<std::size_t>(left + right + 1));
    }
}

TEST_EACH_MODE(depth_ends_exactly_at_the_limit) {
  for (const std::uint32_t depth : {1u, 2u, 16u, 17u, 64u, 65u, 1000u}) {
    World w(Options{.concurrency = c, .max_depth = depth});
    const int n = static_cast<int>(depth);
    grow(w, "root", "a", n);
    // One link more is refused now, but there may be one in the past.
    CHECK_EQ(w.refusal({{nth("a", n), nth("a", n + 1), 1}}), Code::limit);
    const Pose x_past = w.at("root", nth("a", n), 1).pose;
    World past(Options{.concurrency = c, .max_depth = depth});
    grow(past, "root", "a", n);
    // First as a root's child, then below the chain's end, then as a root's child again.
    const std::string last = nth("a", n + 1);
    past.set("top", last, 2);
    past.set("top", last, 3);
    past.set(nth("a", n), last, 1);
    const Pose x_a = w.ask(Op::latest_xact, "root", nth("a", n)).pose;
    CHECK_EQ(w.code(Op::latest_xact, "root", nth("a", n)), Code::ok);
    CHECK_EQ(w.code(Op::at, nth("a", n), "root", 1), Code::ok);
    for (const bool inverse : {false, true}) {
      const std::string deep = nth("a", n + 1);
      const Answer a = inverse ? past.at(deep, "root", 1) : past.at("root", deep, 1);
      CHECK_EQ(a.failure.code, Code::lookup);
      CHECK(a.failure.frame != 0);
    }
    // The limit holds for each side by itself.
    const Pose x_b = grow(w, "root", "b", n);
    check_pose(w, nth("a", n), nth("b", n), inverse(x_a) * x_b, 1, 1e-6);
    // Nothing far above the common ancestor is read.
    CHECK_EQ(past.code(Op::at, "a1", nth("a", n + 1), 1), Code::ok);
    CHECK_NEAR(distance(x_past, x_a), 0, 1e-9);
  }
}

TEST(zero_and_negative_stamps_are_ordinary) {
  World w;
  w.set("a", "b", 0, at_x(1));
  w.set("a", "b", -50, at_x(-1));
  w.set("b", "c", 100);
  w.set("b", "c", -100);
  CHECK_EQ(w.at("a", "b", -25).pose.x, 0);
  CHECK_EQ(w.ask(Op::latest_common, "a", "c").stamp, 0);
  CHECK_EQ(w.ask(Op::latest_common, "a", "c").pose.x, 1);
  CHECK_EQ(w.code(Op::at, "a", "b", 1), Code::forward);
}

TEST_EACH_MODE(the_chain_changes_with_time) {
  World w(c);
  w.set("p1", "c", 10, at_x(1));
  w.set("p2", "c", 20, at_x(2));
  for (const Stamp t : {10, 20}) {
    w.set("w", "p1", t, at_x(static_cast<double>(t)));
    w.set("w", "p2", t, at_x(static_cast<double>(10 * t)));
  }
  CHECK_EQ(w.at("w", "c", 10).pose.x, 11);
  CHECK_EQ(w.at("w", "c", 15).pose.x, 16);
  CHECK_EQ(w.at("w", "c", 20).pose.x, 202);
  CHECK_EQ(w.ask(Op::latest_common, "w", "c").pose.x, 202);
  CHECK_EQ(w.tree.parent(w.id("c"), 15), w.id("p1"));
  CHECK_EQ(w.tree.parent(w.id("c"), kNoStamp), w.id("p2"));
  std::vector<FrameId> chain;
  w.tree.chain(w.query(Op::at, "w", "c", 15), chain);
  const std::vector<FrameId> expected = {w.id("w"), w.id("p1"), w.id("c")};
  CHECK(chain == expected);
  // The latest common time is before the newest link, so the older chain is used.
  w.set("w2", "p1", 30, {}, false);
  w.set("p3", "c", 40, at_x(3));
  w.set("w2", "p3", 15, {}, true);
  CHECK_EQ(w.ask(Op::latest_common, "w2", "c").pose.x, 3);
}

TEST_EACH_MODE(the_latest_common_lookup_uses_the_chain_of_that_time) {
  World w(c);
  w.set("w", "p1", 1, at_x(100), true);
  for (const Stamp t : {10, 20}) w.set("w", "p2", t, at_x(200));
  w.set("p1", "c", 10, at_x(1));
  w.set("p2", "c", 30, at_x(2));
  // The newest links are w - p2 - c, with common time 20; at 20 the parent of c is still p1.
  const Answer a = w.ask(Op::latest_common, "w", "c");
  CHECK_EQ(a.stamp, 20);
  CHECK_EQ(a.pose.x, 101);
  CHECK_EQ(w.ask(Op::latest_common, "c", "w").pose.x, -101);
}

TEST(a_far_ancestor_in_a_past_loop_is_met_at_its_first_visit) {
  World w;
  // At time 1, x and y are each other's parent. The newest links have no loop.
  std::vector<Set> sets = {{"y", "x", 1, at_x(1)},
                           {"map", "x", 2, at_x(1)},
                           {"x", "y", 1, at_x(1)},
                           {"map", "y", 2, at_x(1)}};
  constexpr int kSource = 60, kTarget = 70;  // beyond the near phase of the walk
  const auto add_path = [&](const std::string& prefix, int links) {
    for (int i = 0; i < links; ++i)
      for (const Stamp stamp : {1, 2})
        sets.push_back({i + 1 == links ? "x" : nth(prefix, i + 1), nth(prefix, i), stamp, at_x(1)});
  };
  add_path("s", kSource);
  add_path("t", kTarget);
  CHECK(!w.commit(sets));
  const Answer answer = w.at("t0", "s0", 1);
  CHECK_EQ(answer.failure.code, Code::ok);
  CHECK_EQ(answer.pose.x, double{kSource - kTarget});
}
