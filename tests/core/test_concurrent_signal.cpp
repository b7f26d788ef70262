// Waiting for commits: no wake-up is missed. Deadlines are so far away that a missed one hangs.
#include "crowd.hpp"
#include "fixture.hpp"

using namespace ztf;

namespace {
constexpr std::chrono::hours kNever(1);
}

TEST(ping_pong) {
  CommitSignal signal;
  std::atomic<int> ball{0};
  constexpr int kRounds = 20'000;
  Crowd crowd;
  for (int player = 0; player < 2; ++player)
    crowd.foreground([&, player] {
      for (;;) {
        const std::uint64_t seen = signal.epoch();
        const int now = ball.load(std::memory_order_relaxed);
        if (now >= kRounds) return;
        if (now % 2 == player) {
          ball.store(now + 1, std::memory_order_relaxed);  // ordered by the signal alone
          signal.announce();
        } else {
          signal.wait(seen, CommitSignal::Clock::now() + kNever);
        }
      }
    });
  crowd.join();
  CHECK(ball >= kRounds);
}

TEST(many_waiters_see_every_commit_that_matters) {
  for_each_concurrency([](Concurrency c) {
    World w(c);
    w.set("a", "b", 0);
    constexpr int kRounds = 500, kWaiters = 3;
    std::atomic<int> seen_by[kWaiters] = {};
    Crowd crowd;
    for (int waiter = 0; waiter < kWaiters; ++waiter)
      crowd.foreground([&, waiter] {
        for (int round = 1; round <= kRounds; ++round) {
          for (;;) {
            const std::uint64_t seen = w.tree.signal().epoch();
            const Answer a = w.at("a", "b", round);
            if (a.failure.code == Code::ok) break;
            CHECK(w.tree.may_come(a.failure));
            w.tree.signal().wait(seen, CommitSignal::Clock::now() + kNever);
          }
          seen_by[waiter] = round;
        }
      });
    crowd.foreground([&] {
      for (int round = 1; round <= kRounds; ++round) {
        w.set("a", "b", round);
        // Every other time only once all have gone on to wait, or are about to.
        if (round % 2)
          for (const auto& seen : seen_by)
            while (seen < round) std::this_thread::yield();
      }
    });
    crowd.join();
    for (const auto& seen : seen_by) CHECK_EQ(seen.load(), kRounds);
  });
}

TEST(a_wait_ends_at_its_deadline) {
  CommitSignal signal;
  const auto deadline = CommitSignal::Clock::now() + std::chrono::milliseconds(5);
  signal.wait(signal.epoch(), deadline);
  CHECK(CommitSignal::Clock::now() >= deadline);
  signal.announce();
  signal.wait(signal.epoch() - 1, CommitSignal::Clock::now() + kNever);  // already past: at once
}
