// Removed names lose their ids when new names need them.
#include "fixture.hpp"

using namespace ztf;

namespace {

void remove(World& w, const std::string& name) { w.tree.remove_frame(name, true); }

// Takes the places of all removed names.
void fill(World& w, const std::string& parent = "root") {
  int n = 0;
  while (w.refusal({{parent, nth("filler", n), 1}}) == Code::ok) ++n;
}

constexpr Stamp kFarFuture = 1'000'000'000'000'000;

}  // namespace

TEST(a_rejected_commit_leaves_the_places_to_others) {
  World w(Options{.max_frames = 4});
  w.set("root", "a", 1);
  w.set("root", "b", 1);
  remove(w, "b");
  CHECK_EQ(w.refusal({{"root", "c", 1}, {"root", "d", 1}, {"root", "e", 1}}), Code::limit);
  CHECK_EQ(w.refusal({{"root", "c", 1}, {"c", "c", 1}}), Code::invalid_argument);
  w.accept({{"root", "c", 1}, {"c", "d", 1}});
  CHECK_EQ(w.refusal({{"root", "e", 1}}), Code::limit);
}

TEST(one_commit_brings_names_back_and_takes_ids_of_others) {
  for (std::uint32_t max_frames = 4; max_frames < 12; ++max_frames) {
    World w(Options{.max_frames = max_frames});
    for (int round = 0; round < 20; ++round) {
      w.set("root", "a", round);
      w.set("root", "b", round);
      remove(w, "a");
      remove(w, "b");
      const std::string c = nth("c", round), d = nth("d", round);
      w.accept({{c, "b", 100, at_x(1)}, {"root", c, 100, at_x(10)}});
      CHECK_EQ(w.ask(Op::latest_xact, "root", "b").pose.x, 11.0);
      remove(w, c);
      w.accept({{"root", d, 100, at_x(2)}, {d, "a", 100, at_x(20)}});
      CHECK_EQ(w.ask(Op::latest_xact, "root", "a").pose.x, 22.0);
      remove(w, d);
    }
  }
}

TEST(an_id_that_passed_on_is_noticed) {
  World w(Options{.max_frames = 2});
  w.set("root", "a", 1);
  const Tree::FrameRef root = w.tree.find_ref("root"), a = w.tree.find_ref("a");
  remove(w, "a");
  CHECK(w.tree.is_current(a));  // nobody else has it
  CHECK(!(w.tree.find_ref("a") == a));
  w.set("root", "a", 2);
  CHECK(w.tree.find_ref("a") == a);
  remove(w, "a");
  w.set("root", "b", 3);
  CHECK_EQ(w.id("b"), a.id);
  CHECK(!w.tree.is_current(a));
  CHECK(w.tree.is_current(root));
  CHECK(w.tree.is_current(w.tree.find_ref("none")));
  remove(w, "b");
  w.set("root", "a", 4);  // the same name, again with the same id
  CHECK_EQ(w.id("a"), a.id);
  CHECK(!w.tree.is_current(a));
}

TEST(a_name_that_has_lost_its_id_is_noticed_before_another_gets_it) {
  World w(Options{.max_frames = 3});
  w.set("root", "a", 1);
  w.set("root", "b", 1);
  const Tree::FrameRef a = w.tree.find_ref("a"), b = w.tree.find_ref("b");
  remove(w, "a");
  remove(w, "b");
  w.set("root", "c", 2);  // takes one of the two ids
  CHECK(w.id("c") == a.id || w.id("c") == b.id);
  CHECK(!w.tree.is_current(a) && !w.tree.is_current(b));
}

TEST(a_large_tree_has_more_ids_but_no_more_frames) {
  constexpr std::uint32_t kFrames = 64;
  World w(Options{.max_frames = kFrames});
  for (std::uint32_t i = 1; i < kFrames; ++i) w.set("root", nth("f", static_cast<int>(i)), 1);
  for (int i = 1; i < 200; ++i) {
    CHECK_EQ(w.refusal({{"root", "one too many", 1}}), Code::limit);
    remove(w, nth("f", i));
    CHECK(w.set("root", nth("f", i + static_cast<int>(kFrames) - 1), 1));
    CHECK_EQ(w.refusal({{"root", nth("f", i), 1}}), Code::limit);  // nor one that comes back
  }
  CHECK(w.tree.size() > kFrames && w.tree.size() <= kFrames + kFrames / 16);
}

TEST(a_failure_does_not_name_the_next_owner_of_an_id) {
  World w(Options{.max_frames = 3});
  w.set("root", "a", 10);
  const Failure failure = w.at("root", "a", 20).failure;
  CHECK_EQ(w.tree.name(failure, failure.frame), std::string("a"));
  CHECK_EQ(w.tree.name(failure, failure.parent), std::string("root"));
  remove(w, "a");
  fill(w);
  CHECK_EQ(w.tree.name(failure, failure.frame), std::string());
  for (int i = 0; w.id(nth("filler", i)) != 0; ++i) w.set("root", nth("filler", i), kFarFuture);
  CHECK(may_succeed_later(w.tree.state(), failure));  // the next owner's history says nothing
}

// Whichever ids a name has had, no read set of it passes after it was removed.
TEST(the_versions_of_a_name_only_grow) {
  for (std::uint32_t max_frames = 4; max_frames < 9; ++max_frames) {
    World w(Options{.max_frames = max_frames});
    w.set("root", "anchor", 1);
    std::map<std::string, Version> last;
    std::uint32_t random = 1;
    int came_back = 0;
    for (int step = 0; step < 3000; ++step) {
      random = random * 1664525 + 1013904223;
      const std::string name = nth("f", static_cast<int>(random >> 8) % 9);
      const std::string parent = nth("f", static_cast<int>(random >> 16) % 9);
      if (random >> 30 == 0) {
        if (w.id(name) != 0) remove(w, name);
      } else if (random >> 30 == 1) {
        w.refusal({{parent, name, step}, {"root", parent, step}});
      } else {
        w.refusal({{"root", name, step}});
      }
      for (int i = 0; i < 9; ++i) {
        const FrameId id = w.id(nth("f", i));
        Version& before = last[nth("f", i)];
        if (id == 0) {
          before |= 1;  // was removed
          continue;
        }
        const Version now = w.tree.version(id);
        if (before & 1) ++came_back;
        CHECK(now != 0 && (before & 1 ? now > before - 1 : now >= before));
        before = now;
      }
    }
    CHECK(came_back > 100);
  }
}

TEST_EACH_MODE(a_past_link_to_a_removed_frame_ends_at_its_child) {
  World w(Options{.concurrency = c, .max_frames = 6});
  w.set("root", "old", 1, at_x(100));
  w.set("root", "old", 90, at_x(100));
  w.set("old", "child", 10, at_x(1));
  w.set("older", "child", 20, at_x(2));
  w.set("old", "child", 30, at_x(3));
  w.set("root", "child", 40, at_x(4));
  w.set("root", "child", 50, at_x(5));
  CHECK_EQ(w.at("root", "child", 10).pose.x, 101.0);
  remove(w, "old");
  remove(w, "older");
  const Version before = w.version("child");
  fill(w);
  CHECK(w.version("child") > before);
  for (int i = 0; w.id(nth("filler", i)) != 0; ++i) w.set("root", nth("filler", i), 90);
  for (const Stamp stamp : {10, 15, 20, 25, 30, 35}) {
    const Answer a = w.at("root", "child", stamp);
    CHECK_EQ(a.failure.code, Code::connectivity);
    CHECK_EQ(a.failure.source_root, w.id("child"));
    CHECK_EQ(w.tree.parent(w.id("child"), stamp), 0u);
  }
  CHECK_EQ(w.at("root", "child", 45).pose.x, 4.5);
  CHECK_EQ(w.at("root", "child", 5).failure.code, Code::backward);
  // The samples can still be replaced, inserted between, and pruned.
  CHECK(w.set("root", "child", 20, at_x(2)));
  CHECK(w.set("root", "child", 30, at_x(3)));
  CHECK_EQ(w.at("root", "child", 25).pose.x, 2.5);
  CHECK_EQ(w.at("root", "child", 15).failure.code, Code::connectivity);
  CHECK(w.set("root", "child", 10, at_x(1)));
  CHECK_EQ(w.at("root", "child", 15).pose.x, 1.5);
}

TEST(a_frame_with_an_id_of_another_begins_with_nothing) {
  World w(Options{.cache_ns = 100, .max_frames = 3, .max_samples_per_frame = 2});
  for (Stamp t = 1; t <= 5; ++t) w.set("root", "a", 1000 + t);
  w.set("root", "a", 1005);
  w.set("root", "a", 1);      // dropped
  w.set("other", "a", 1006);  // another parent
  CHECK_EQ(w.info("a").evicted, 4u);
  CHECK_EQ(w.events("a").dropped.load(), 1u);
  remove(w, "a");
  w.set("root", "b", 1);
  CHECK_EQ(w.id("a"), 0u);
  const FrameInfo info = w.info("b");
  CHECK_EQ(info.evicted, 0u);
  CHECK_EQ(info.samples, 1u);
  CHECK(info.change == FrameEvents::Change::none);
  CHECK_EQ(w.events("b").dropped.load(), 0u);
  CHECK_EQ(w.tree.totals().evicted, 4u);
  CHECK_EQ(w.tree.totals().rewritten, 1u);
  CHECK_EQ(w.tree.totals().dropped, 1u);
  const auto [events, lost] = w.tree.take_events();
  CHECK(events.empty());
  CHECK_EQ(lost, 2u);  // a sample too late, and the new parent
}

TEST(events_name_the_frames_that_they_happened_to) {
  World w(Options{.max_frames = 5});
  w.set("root", "a", 1);
  w.set("other", "a", 2);
  remove(w, "root");
  w.set("other", "b", 1);
  fill(w, "other");
  const auto [events, lost] = w.tree.take_events();
  CHECK_EQ(lost, 0u);
  CHECK_EQ(events.size(), 1u);
  CHECK_EQ(events[0].frame, "a");
  CHECK_EQ(events[0].parent, "other");
  CHECK_EQ(events[0].parent_before, "");  // its name was removed
  CHECK_EQ(w.info("a").parent_before, 0u);
}

TEST(a_waiting_lookup_follows_its_name_to_another_id) {
  World w(Options{.max_frames = 3});
  w.set("root", "a", 1);
  CountingWaiter waiter(w, Op::at, "root", "a", 5);
  CHECK(!waiter.lookup_or_park());
  const FrameId before = w.id("a");
  remove(w, "a");
  CHECK_EQ(waiter.woken, 1);
  CHECK(!waiter.lookup_or_park());  // under the name
  w.set("root", "b", 1);
  w.set("b", "c", 1);
  CHECK_EQ(waiter.woken, 1);
  remove(w, "b");
  w.set("root", "a", 5, at_x(7));
  CHECK(w.id("a") != 0 && before != 0);
  CHECK_EQ(waiter.woken, 2);
  CHECK(waiter.lookup_or_park());
  CHECK_EQ(waiter.answer().pose.x, 7.0);
}

TEST(a_write_by_references_never_reaches_the_next_owner_of_an_id) {
  World w(Options{.max_frames = 3});
  w.set("root", "a", 1);
  const std::vector<NameRef> link{w.tree.find_ref("root"), w.tree.find_ref("a")};
  CHECK(!w.append(link, 2, at_x(2)));
  remove(w, "a");
  CHECK_EQ(w.append(link, 3, at_x(3))->code, Code::stale_frame);
  fill(w);
  CHECK_EQ(w.append(link, 4, at_x(4))->code, Code::stale_frame);
  CHECK_EQ(w.append({link[0], {}}, 4, at_x(4))->code, Code::stale_frame);
  CHECK_EQ(w.ask(Op::latest, "root", "filler0").pose.x, 0.0);
}
