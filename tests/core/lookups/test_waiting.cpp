// Which commits wake a waiting lookup, and which do not.
#include "fixture.hpp"

using namespace ztf;

namespace {

Options short_cache() { return {.cache_ns = 100}; }

}  // namespace

TEST(only_the_commit_that_brings_the_sample_wakes) {
  World w(short_cache());
  w.set("map", "base", 10);
  w.set("base", "camera", 10);
  w.set("base", "lidar", 10);
  CountingWaiter waiter(w, Op::at, "map", "camera", 50);
  CHECK(!waiter.lookup_or_park());
  CHECK(waiter.code() == Code::no_data);
  w.set("base", "lidar", 50);  // a frame that is not on the path
  w.set("map", "base", 20);    // frames on the path, but too early
  w.set("base", "camera", 40);
  CHECK_EQ(waiter.woken, 0);
  w.set("base", "camera", 60);  // around 50: the next link may have a sample already
  CHECK_EQ(waiter.woken, 1);
  CHECK(!waiter.lookup_or_park());  // it has none
  w.set("base", "camera", 70);
  CHECK_EQ(waiter.woken, 1);
  w.set("map", "base", 50);
  CHECK_EQ(waiter.woken, 2);
  CHECK(waiter.lookup_or_park());
  CHECK(waiter.code() == Code::ok);
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

TEST(a_wait_for_the_past_ends_when_it_comes_or_never_can) {
  World w(short_cache());
  w.set("a", "b", 90);
  w.set("a", "b", 100);
  CountingWaiter comes(w, Op::at, "a", "b", 50), never(w, Op::at, "a", "b", 40),
      too_old(w, Op::at, "a", "b", -1);
  CHECK(too_old.lookup_or_park());
  CHECK(too_old.code() == Code::backward);
  CHECK(!comes.lookup_or_park());
  CHECK(!never.lookup_or_park());
  w.set("a", "b", 140);  // 40 is exactly as old as allowed
  CHECK_EQ(never.woken, 0);
  w.set("a", "b", 45);
  CHECK_EQ(comes.woken, 1);
  CHECK(comes.lookup_or_park());
  CHECK(comes.code() == Code::ok);
  CHECK_EQ(never.woken, 1);  // a late sample was inserted: it looks again
  CHECK(!never.lookup_or_park());
  w.set("a", "b", 141);
  CHECK_EQ(never.woken, 2);
  CHECK(never.lookup_or_park());
  CHECK(never.code() == Code::backward);
}

TEST(a_wait_ends_in_failure_when_a_link_on_its_path_prunes_that_time) {
  World w(short_cache());
  w.set("a", "b", 10);
  w.set("b", "c", 10);
  w.set("b", "c", 20);
  CountingWaiter waiter(w, Op::at, "a", "c", 15);
  CHECK(!waiter.lookup_or_park());
  w.set("b", "c", 110);
  CHECK_EQ(waiter.woken, 0);
  w.set("b", "c", 116);  // this prunes the sample before 15
  CHECK_EQ(waiter.woken, 1);
  CHECK(waiter.lookup_or_park());
  CHECK(waiter.code() == Code::backward);
}

TEST(a_new_name_wakes_the_lookups_that_miss_it) {
  World w;
  w.set("a", "b", 1);
  CountingWaiter waiter(w, Op::latest_common, "a", "ghost"), both(w, Op::latest_common, "x", "x");
  CHECK(!waiter.lookup_or_park());
  CHECK(!both.lookup_or_park());
  w.set("a", "other", 1);
  CHECK_EQ(waiter.woken, 0);
  w.set("ghost", "child", 1);  // it exists now, in another tree
  CHECK_EQ(waiter.woken, 1);
  CHECK(!waiter.lookup_or_park());
  CHECK(waiter.code() == Code::connectivity);
  w.set("ghost", "child", 2);
  w.set("a", "b", 2);
  CHECK_EQ(waiter.woken, 1);
  w.set("b", "ghost", 2);
  CHECK_EQ(waiter.woken, 2);
  CHECK(waiter.lookup_or_park());
  CHECK(waiter.code() == Code::ok);
  CHECK_EQ(both.woken, 0);
  w.set("x", "y", 1);
  CHECK_EQ(both.woken, 1);
  CHECK(both.lookup_or_park());
}

TEST(the_latest_common_time_may_be_moved_by_any_link) {
  World w;
  w.set("p", "a", 3);
  w.set("p", "b", 4);
  CountingWaiter waiter(w, Op::latest_common, "a", "b");
  CHECK(!waiter.lookup_or_park());
  CHECK(waiter.code() == Code::no_data);
  w.set("p", "a", 4);
  CHECK_EQ(waiter.woken, 1);
  CHECK(waiter.lookup_or_park());
  CHECK(waiter.code() == Code::ok);
}

TEST(switches_and_new_parents_wake) {
  World w;
  w.set("a", "b", 1);
  w.set("b", "c", 1);
  w.set("b", "c", 9);
  {
    CountingWaiter waiter(w, Op::at, "a", "c", 5);
    CHECK(!waiter.lookup_or_park());
    w.set("other", "c", 2);  // another parent on the path
    CHECK_EQ(waiter.woken, 1);
    CHECK(!waiter.lookup_or_park());
    w.set("b", "c", 2);
    CHECK_EQ(waiter.woken, 2);
    CHECK(!waiter.lookup_or_park());
    w.set("a", "b", 0, {}, true);  // static: any time
    CHECK_EQ(waiter.woken, 3);
    CHECK(waiter.lookup_or_park());
    CHECK(waiter.code() == Code::ok);
  }
  w.tree.clear(false);
  w.set("a", "b", 1);
  w.set("b", "c", 1);
  CountingWaiter waiter(w, Op::at, "a", "c", 5);
  CHECK(!waiter.lookup_or_park());
  w.tree.clear(true);
  CHECK_EQ(waiter.woken, 1);
  CHECK(!waiter.lookup_or_park());
  CHECK(waiter.code() == Code::connectivity);
  w.set("a", "b", 5);
  w.set("b", "c", 5);
  CHECK_EQ(waiter.woken, 2);
  CHECK(waiter.lookup_or_park());
  CHECK(waiter.code() == Code::ok);
}

TEST(a_cancelled_waiter_is_not_woken_and_leaves_nothing) {
  World w;
  w.set("a", "b", 1);
  CountingWaiter waiter(w, Op::at, "a", "b", 5);
  CHECK(!waiter.cancel());
  CHECK(!waiter.lookup_or_park());
  CHECK_EQ(w.tree.wait_list().size(), 1u);
  CHECK(waiter.cancel());
  CHECK(!waiter.cancel());
  CHECK_EQ(w.tree.wait_list().size(), 0u);
  w.set("a", "b", 5);
  CHECK_EQ(waiter.woken, 0);
}

TEST(through_a_fixed_frame_the_leg_that_fails_is_waited_for) {
  World w;
  w.set("map", "base", 1);
  w.set("map", "base", 9);
  w.set("map", "arm", 1);
  std::string_view fixed = "map";
  BlockingWaiter sleeper(w.tree.state(), {Op::full, 0, 0, 5, 0, 5}, "base", "arm", fixed);
  using namespace std::chrono_literals;
  CHECK(!sleeper.wait(BlockingWaiter::Clock::now()));
  CHECK(sleeper.answer().failure.code == Code::no_data);
  w.set("map", "arm", 5);
  CHECK(sleeper.wait(BlockingWaiter::Clock::now() + 1h));
  CHECK(sleeper.answer().failure.code == Code::ok);
}

TEST(a_wait_for_a_time_before_a_full_history_fails) {
  World w(Options{.max_samples_per_frame = 4});
  for (const Stamp stamp : {10, 20, 30}) w.set("a", "b", stamp);
  CountingWaiter waiter(w, Op::at, "a", "b", 5);
  CHECK(!waiter.lookup_or_park());  // a late sample would still be stored
  w.set("a", "b", 40);
  CHECK_EQ(waiter.woken, 1);
  CHECK(waiter.lookup_or_park());
  CHECK(waiter.code() == Code::backward);

  CountingWaiter late(w, Op::at, "a", "b", 7);
  CHECK(late.lookup_or_park());
  CHECK(late.code() == Code::backward);
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

// A lookup at two times fails for good as soon as one of its halves does, whichever it waits for.
TEST(a_wait_at_two_times_ends_when_either_leaves_the_history) {
  const auto fill = [](World& w) {
    for (const char* child : {"a", "b"})
      for (const Stamp stamp : {1000, 1050}) w.set("map", child, stamp);
  };
  // The target's half is waited for, the source's becomes impossible.
  World w(short_cache());
  fill(w);
  CountingWaiter target(w, "b", 2000, "map", "a", 1010), source(w, "b", 1010, "map", "a", 2000);
  CHECK(!target.lookup_or_park());
  CHECK(!source.lookup_or_park());
  for (const Stamp stamp : {1060, 1070}) w.set("map", "a", stamp);
  CHECK_EQ(target.woken, 0);
  CHECK_EQ(source.woken, 0);
  w.set("map", "a", 1200);
  CHECK_EQ(target.woken, 1);
  CHECK_EQ(source.woken, 0);
  CHECK(target.lookup_or_park());
  CHECK(target.code() == Code::no_data);
  // And the other way round.
  w.set("map", "b", 1200);
  CHECK_EQ(source.woken, 1);
  CHECK(source.lookup_or_park());
  CHECK(source.code() == Code::no_data);
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

TEST(a_wait_at_two_times_is_woken_once_by_a_frame_of_both_halves) {
  World w(short_cache());
  for (const Stamp stamp : {1000, 1050}) w.set("map", "base", stamp), w.set("base", "arm", stamp);
  CountingWaiter waiter(w, "arm", 1020, "map", "arm", 1060);
  CHECK(!waiter.lookup_or_park());
  w.set("map", "base", 1060);
  w.tree.clear(false);
  CHECK_EQ(waiter.woken, 1);
  CHECK(!waiter.lookup_or_park());
  CHECK(waiter.cancel());
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}
