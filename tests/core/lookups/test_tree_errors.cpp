// Every way in which a lookup can fail, and the facts that the failure carries.
#include "fixture.hpp"

using namespace ztf;

TEST_EACH_MODE(unknown_frames) {
  World w(c);
  CHECK_EQ(w.code(Op::at, "a", "b", 1), Code::lookup);
  CHECK_EQ(w.code(Op::at, "a", "a", 1), Code::lookup);
  w.set("foo", "child", 1);
  for (const Op op : {Op::at, Op::latest_common, Op::latest, Op::latest_xact, Op::common_time}) {
    const Answer a = w.ask(op, "foo", "bar", 1);
    CHECK_EQ(a.failure.code, Code::lookup);
    CHECK_EQ(a.failure.target, w.id("foo"));
    CHECK_EQ(a.failure.source, 0u);
    CHECK_EQ(a.failure.frame, 0u);
    CHECK(may_succeed_later(w.tree.state(), a.failure));
    CHECK_EQ(w.code(op, "bar", "foo", 1), Code::lookup);
    CHECK_EQ(w.code(op, "foo", "foo", 1), Code::ok);
  }
}

TEST_EACH_MODE(two_trees) {
  World w(c);
  w.set("a", "b", 1);
  w.set("c", "d", 1);
  for (const Op op : {Op::at, Op::latest_common, Op::latest, Op::latest_xact, Op::common_time}) {
    const Answer a = w.ask(op, "b", "d", 1);
    CHECK_EQ(a.failure.code, Code::connectivity);
    CHECK_EQ(a.failure.target, w.id("b"));
    CHECK_EQ(a.failure.source, w.id("d"));
    CHECK(may_succeed_later(w.tree.state(), a.failure));
  }
}

TEST_EACH_MODE(a_link_without_a_sample_for_the_time) {
  World w(c);
  w.set("foo", "bar", 2000);
  const auto check = [&](Stamp stamp, Code code, Stamp oldest, Stamp newest) {
    for (const bool inverse : {false, true}) {
      const Answer a = inverse ? w.at("bar", "foo", stamp) : w.at("foo", "bar", stamp);
      CHECK_EQ(a.failure.code, code);
      if (code == Code::ok) continue;
      CHECK_EQ(a.failure.target, w.id(inverse ? "bar" : "foo"));
      CHECK_EQ(a.failure.source, w.id(inverse ? "foo" : "bar"));
      CHECK_EQ(a.failure.frame, w.id("bar"));
      CHECK_EQ(a.failure.parent, w.id("foo"));
      CHECK_EQ(a.failure.stamp, stamp);
      CHECK_EQ(a.failure.oldest, oldest);
      CHECK_EQ(a.failure.newest, newest);
    }
  };
  check(2000, Code::ok, 0, 0);
  check(4000, Code::no_data, 2000, 2000);
  check(1000, Code::no_data, 2000, 2000);
  w.set("foo", "bar", 3000);
  check(2000, Code::ok, 0, 0);
  check(2500, Code::ok, 0, 0);
  check(1999, Code::backward, 2000, 3000);
  check(3001, Code::forward, 2000, 3000);
}

// Of several links without a sample the error names the one whose samples are farthest from the
// time, whichever frame is the target; of equal ones the target's.
TEST_EACH_MODE(the_link_that_is_farthest_from_the_time_is_named) {
  World w(c);
  for (const Stamp t : {10, 20}) {
    w.set("root", "l", t);
    w.set("l", "ll", t + 5);
    w.set("root", "r", t + 100);
    w.set("top", "root", t + 1000);
  }
  const auto check = [&](const char* target, const char* source, Stamp stamp, const char* link,
                         Code code, Stamp oldest) {
    const Failure failure = w.at(target, source, stamp).failure;
    CHECK_EQ(failure.code, code);
    CHECK_EQ(failure.frame, w.id(link));
    CHECK_EQ(failure.parent, w.tree.parent(w.id(link), kNoStamp));
    CHECK_EQ(failure.stamp, stamp);
    CHECK_EQ(failure.oldest, oldest);
    CHECK_EQ(failure.newest, oldest + 10);
  };
  for (const auto& [target, source] : {std::pair{"ll", "r"}, {"r", "ll"}}) {
    check(target, source, 50, "r", Code::backward, 110);
    check(target, source, 80, "l", Code::forward, 10);
    check(target, source, 200, "l", Code::forward, 10);
    check(target, source, 1, "r", Code::backward, 110);
    check(target, source, 22, "r", Code::backward, 110);
  }
  check("l", "r", 65, "l", Code::forward, 10);
  check("r", "l", 65, "r", Code::backward, 110);
  // The link above the common ancestor is not on the path, although a walk that fails reads it.
  check("root", "ll", 60, "l", Code::forward, 10);
  check("l", "ll", 60, "ll", Code::forward, 15);
}

TEST_EACH_MODE(a_cycle_at_a_past_time) {
  World w(c);
  // Until 20 b was the parent of a; from 20 on a is the parent of b. At 15 neither is a root.
  for (const Stamp t : {10, 20}) w.set("b", "a", t);
  w.set("root", "a", 30);
  for (const Stamp t : {40, 50}) w.set("a", "b", t);
  CHECK(w.set("a", "b", 11));
  CHECK(w.set("a", "b", 19));
  const Answer a = w.at("root", "b", 15);
  CHECK_EQ(a.failure.code, Code::lookup);
  CHECK(a.failure.frame != 0);
  CHECK(!may_succeed_later(w.tree.state(), a.failure));
  CHECK_EQ(w.code(Op::latest_xact, "root", "b"), Code::ok);
}

TEST(what_can_still_come) {
  World w(Options{.cache_ns = 1000});
  for (const Stamp t : {5000, 5500}) w.set("a", "b", t);
  CHECK(may_succeed_later(w.tree.state(), w.at("a", "b", 6000).failure));
  CHECK(may_succeed_later(w.tree.state(), w.at("a", "b", 4500).failure));
  CHECK(!may_succeed_later(w.tree.state(), w.at("a", "b", 4499).failure));
  CHECK(may_succeed_later(w.tree.state(), {.code = Code::connectivity}));
  CHECK(!may_succeed_later(w.tree.state(), {.code = Code::invalid_argument}));
}

TEST_EACH_MODE(full_lookups_blame_the_leg_that_failed) {
  World w(c);
  for (const Stamp t : {10, 20}) {
    w.set("fixed", "a", t, at_x(static_cast<double>(t)));
    w.set("fixed", "b", t + 100, at_x(-1));
  }
  const auto full = [&](const char* target, Stamp t, const char* source, Stamp s,
                        const char* fixed) {
    Answer a;
    w.tree.lookup({Op::full, w.id(target), w.id(source), t, w.id(fixed), s}, a);
    return a;
  };
  const Answer ok = full("b", 115, "a", 15, "fixed");
  CHECK_EQ(ok.failure.code, Code::ok);
  CHECK_EQ(ok.pose.x, 16);
  CHECK_EQ(ok.stamp, 115);
  CHECK_EQ(full("b", kNoStamp, "a", kNoStamp, "fixed").pose.x, 21);
  const Answer source_leg = full("b", 115, "a", 25, "fixed");
  CHECK_EQ(source_leg.failure.code, Code::forward);
  CHECK_EQ(source_leg.failure.frame, w.id("a"));
  CHECK_EQ(source_leg.failure.target, w.id("fixed"));
  const Answer target_leg = full("b", 15, "a", 15, "fixed");
  CHECK_EQ(target_leg.failure.code, Code::backward);
  CHECK_EQ(target_leg.failure.frame, w.id("b"));
  CHECK_EQ(full("b", 115, "a", 15, "nope").failure.code, Code::lookup);
  CHECK_EQ(full("nope", 115, "nope", 15, "nope").failure.code, Code::lookup);
  CHECK_EQ(full("b", 115, "b", 15, "b").failure.code, Code::ok);
}
