// Waiting for commits: no wake-up is lost. Deadlines are so far away that a lost one hangs the
// test.
#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr std::chrono::hours kNever(1);

void wait_for(World& w, Op op, std::string_view target, std::string_view source,
              Stamp stamp = kNoStamp) {
  BlockingWaiter sleeper(w.tree.state(), {op, 0, 0, stamp}, target, source);
  CHECK(sleeper.wait(BlockingWaiter::Clock::now() + kNever));
  CHECK(sleeper.answer().failure.code == Code::ok);
}

}  // namespace

TEST_EACH_MODE(ping_pong) {
  World w(c);
  w.set("map", "ping", 0);
  w.set("map", "pong", 0);
  constexpr Stamp kRounds = 2'000;
  ThreadGroup threads;
  threads.foreground([&] {
    for (Stamp round = 1; round <= kRounds; ++round) {
      w.set("map", "ping", round);
      wait_for(w, Op::at, "map", "pong", round);
    }
  });
  threads.foreground([&] {
    for (Stamp round = 1; round <= kRounds; ++round) {
      wait_for(w, Op::at, "map", "ping", round);
      w.set("map", "pong", round);
    }
  });
  threads.join();
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

TEST_EACH_MODE(many_waiters_see_every_commit_that_matters) {
  World w(c);
  w.set("a", "b", 0);
  w.set("b", "c", 0);
  constexpr int kRounds = 500, kWaiters = 3;
  std::atomic<int> seen_by[kWaiters] = {};
  ThreadGroup threads;
  threads.foreground(kWaiters, [&](int waiter) {
    for (int round = 1; round <= kRounds; ++round) {
      wait_for(w, Op::at, "a", "c", round);
      seen_by[waiter] = round;
    }
  });
  threads.foreground([&] {
    for (int round = 1; round <= kRounds; ++round) {
      w.set("a", "b", round);
      w.set("b", "c", round);
      // In every other round, writes on only once all waiters wait for the next round, or soon
      // will.
      if (round % 2)
        for (const auto& seen : seen_by)
          while (seen < round) std::this_thread::yield();
    }
  });
  threads.join();
  for (const auto& seen : seen_by) CHECK_EQ(seen.load(), kRounds);
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

TEST_EACH_MODE(names_and_links_that_appear_wake) {
  World w(c);
  constexpr int kRounds = 300;
  const auto name = [](const char* kind, int round) { return nth(kind, round); };
  ThreadGroup threads;
  threads.foreground(2, [&](int) {
    for (int round = 0; round < kRounds; ++round) {
      const std::string root = name("root", round), leaf = name("leaf", round);
      wait_for(w, Op::latest_common, root, leaf);
    }
  });
  threads.foreground([&] {
    for (int round = 0; round < kRounds; ++round) {
      w.set(name("middle", round), name("leaf", round), 1);
      w.set(name("root", round), name("middle", round), 1);
    }
  });
  threads.join();
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

TEST_EACH_MODE(waiters_come_and_go_while_others_write) {
  World w(c);
  for (int i = 0; i < 4; ++i) w.set("map", nth("f", i), 0);
  std::atomic<Stamp> now{0};
  ThreadGroup threads;
  threads.background(2, [&](int writer, const std::atomic<bool>& stop) {
    while (!stop) {
      const Stamp stamp = now.fetch_add(1) + 1;
      w.set("map", nth("f", writer), stamp);
      w.set("map", nth("f", writer + 2), stamp);
    }
  });
  threads.foreground(2, [&](int waiter) {
    const std::string target = nth("f", waiter), source = "f3";
    for (int i = 0; i < 1'000; ++i) {
      const Stamp stamp = now + 3;
      BlockingWaiter sleeper(w.tree.state(), {Op::at, 0, 0, stamp}, target, source);
      if (i % 2) {
        (void)sleeper.wait(BlockingWaiter::Clock::now());  // times out at once
      } else {
        CHECK(sleeper.wait(BlockingWaiter::Clock::now() + kNever));
      }
    }
  });
  threads.join();
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

TEST(a_wait_ends_at_its_deadline) {
  World w;
  w.set("a", "b", 0);
  BlockingWaiter sleeper(w.tree.state(), {Op::at, 0, 0, 5}, "a", "b");
  const auto deadline = BlockingWaiter::Clock::now() + std::chrono::milliseconds(5);
  CHECK(!sleeper.wait(deadline));
  CHECK(BlockingWaiter::Clock::now() >= deadline);
  w.set("a", "b", 5);
  CHECK(sleeper.wait(BlockingWaiter::Clock::now() + kNever));
}
