// A test for each fault of an earlier implementation of this idea (the report that bench/README.md
// names). Some of these tests are in other files:
// - a commit of which a part is rejected stores the other part: bad_rows_leave_nothing_behind
// - two threads give the same name two ids: one_name_one_id
// - the last link is lost if the target is an ancestor: ancestors_descendants_and_cousins
// - a loop is followed for ever: depth_ends_exactly_at_the_limit, a_cycle_at_a_past_time
#include <algorithm>
#include <random>

#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

std::string link(int i) { return nth("f", i); }

// f0 <- f1 <- ... <- f<links>, all with the same stamp and the same pose.
std::vector<Set> chain(int links, Stamp stamp, double x) {
  std::vector<Set> sets;
  for (int i = 1; i <= links; ++i) sets.push_back({link(i - 1), link(i), stamp, at_x(x)});
  return sets;
}

}  // namespace

// Lookups of (a, b) and (b, a) visit the frames in opposite orders.
TEST_EACH_MODE(crossed_lookups_do_not_block) {
  World w(c);
  constexpr int kLinks = 6;
  w.accept(chain(kLinks, 1, 1));
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    for (Stamp stamp = 2; !stop; ++stamp)
      w.accept(chain(kLinks, stamp, static_cast<double>(stamp)));
  });
  threads.foreground(4, [&](int thread) {
    const bool up = thread % 2 == 0;
    for (int i = 0; i < 2000; ++i) {
      const Answer a = up ? w.ask(Op::latest_common, "f0", link(kLinks))
                          : w.ask(Op::latest_common, link(kLinks), "f0");
      CHECK_EQ(a.failure.code, Code::ok);
      CHECK_EQ(a.pose.x, (up ? kLinks : -kLinks) * static_cast<double>(a.stamp));
    }
  });
  threads.join();
}

// Locks are taken in ascending order, and once per frame, whatever the rows say.
TEST_EACH_MODE(rows_in_any_order_and_twice_do_not_block) {
  World w(c);
  constexpr int kLinks = 8, kCommits = 500;
  w.accept(chain(kLinks, 0, 0));
  ThreadGroup threads;
  threads.foreground(3, [&](int thread) {
    std::mt19937 random(thread);
    for (int i = 1; i <= kCommits; ++i) {
      std::vector<Set> sets = chain(kLinks, i, i);
      for (const Set& again : chain(kLinks, i, i)) sets.push_back(again);
      std::shuffle(sets.begin(), sets.end(), random);
      w.accept(sets);
    }
  });
  threads.join();
  for (int i = 1; i <= kLinks; ++i)
    CHECK_EQ(w.info(link(i)).version / kVersionStep, Version{3 * kCommits + 1});
}

// A lookup that retries discards what it has composed. The chain's length changes from commit to
// commit, so that leftovers would show.
TEST_EACH_MODE(a_lookup_that_retries_keeps_nothing) {
  World w(c);
  constexpr int kLinks = 12;
  w.accept(chain(kLinks, 1, 1));
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    for (Stamp stamp = 2; !stop; ++stamp) {
      std::vector<Set> sets = chain(kLinks, stamp, 1);
      if (stamp % 2) sets[6].parent = "f0";
      w.accept(sets);
    }
  });
  for (const Op op : {Op::latest_xact, Op::latest_common})
    threads.foreground([&, op] {
      for (int i = 0; i < 1500; ++i) {
        const Answer a = w.ask(op, "f0", link(kLinks));
        CHECK_EQ(a.failure.code, Code::ok);
        CHECK(a.pose.x == kLinks || a.pose.x == kLinks - 6);
      }
    });
  threads.join();
}

// Two frames move from one tree to another in one commit, so they are always connected. A lookup
// that fails has seen one of them before the commit and the other one after it.
TEST_EACH_MODE(no_error_is_made_of_two_states) {
  World w(c);
  w.accept({{"here", "a", 1}, {"here", "b", 1}});
  w.accept({{"there", "else", 1}});
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    for (Stamp stamp = 2; !stop; ++stamp) {
      const char* const parent = stamp % 2 ? "here" : "there";
      w.accept({{parent, "a", stamp}, {parent, "b", stamp}});
    }
  });
  for (const Op op : {Op::latest_xact, Op::latest_common, Op::latest})
    threads.foreground([&, op] {
      for (int i = 0; i < 1500; ++i) CHECK_EQ(w.code(op, "a", "b"), Code::ok);
    });
  threads.join();
}

// A thread that waits for long sleeps, so many more threads than processors all make progress.
TEST_EACH_MODE(far_more_threads_than_processors_make_progress) {
  World w(c);
  constexpr int kLinks = 16, kEach = 100;
  w.accept(chain(kLinks, 0, 0));
  std::atomic<Stamp> stamp{1};
  ThreadGroup threads;
  for (int thread = 0; thread < 12; ++thread) {
    threads.foreground([&] {
      for (int i = 0; i < kEach; ++i) {
        const Stamp now = stamp.fetch_add(1);
        w.accept(chain(kLinks, now, static_cast<double>(now)));
      }
    });
    threads.foreground([&] {
      for (int i = 0; i < kEach; ++i)
        CHECK_EQ(w.code(Op::latest_xact, "f0", link(kLinks)), Code::ok);
    });
  }
  threads.join();
  CHECK_EQ(w.info("f1").version / kVersionStep, Version{12 * kEach + 1});
}
