// Readers against writers: a transaction reads the tree's state at one instant.
#include <chrono>
#include <functional>
#include <random>

#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr int kLinks = 8;

// Chains f0 .. f8 whose x always sum to zero, and arms l1 .. l4, r1 .. r4 of f0 whose sums are
// equal. Whole numbers: every sum is exact.
std::vector<Set> zero_sum(std::mt19937& random, Stamp stamp) {
  std::vector<Set> sets;
  int sum = 0, left = 0;
  for (int i = 1; i <= kLinks; ++i) {
    const int x = i < kLinks ? static_cast<int>(random() % 2001) - 1000 : -sum;
    sum += x;
    sets.push_back({nth("f", i - 1), nth("f", i), stamp, at_x(x)});
  }
  for (const std::string arm : {"l", "r"}) {
    int reached = 0;
    for (int i = 1; i <= 4; ++i) {
      const int x =
          arm == "r" && i == 4 ? left - reached : static_cast<int>(random() % 2001) - 1000;
      reached += x;
      sets.push_back({i == 1 ? "f0" : nth(arm, i - 1), nth(arm, i), stamp, at_x(x)});
    }
    left = reached;
  }
  return sets;
}

struct ZeroSums {
  explicit ZeroSums(Concurrency c) : world(Options{.concurrency = c, .max_samples_per_frame = 32}) {
    std::mt19937 random(1);
    for (int i = 0; i < 3; ++i) world.accept(zero_sum(random, ++clock));
  }
  void write(unsigned seed, const std::atomic<bool>& stop) {
    std::mt19937 random(seed);
    while (!stop) {
      // Out of order at times, by two writers; a straggler of a full frame may be refused.
      const Code code = world.refusal(zero_sum(random, ++clock));
      CHECK(code == Code::ok || code == Code::invalid_argument);
      if (code == Code::ok) ++commits;
    }
  }
  World world;
  std::atomic<Stamp> clock{0};
  std::atomic<int> commits{0};
};

}  // namespace

TEST_EACH_MODE(transactions_never_see_torn_chains) {
  ZeroSums z(c);
  const World& w = z.world;
  ThreadGroup threads;
  threads.background(2, [&](int i, const auto& stop) { z.write(i + 2, stop); });
  threads.foreground(2, [&](int thread) {
    int past = 0;
    for (int i = 0; i < 150 || z.commits < 60; ++i) {
      // Crossed: one thread looks up (a, b) where the other looks up (b, a).
      const bool crossed = (i + thread) % 2;
      const std::string top = crossed ? "f8" : "f0", leaf = crossed ? "f0" : "f8";
      const std::string one = crossed ? "l4" : "r4", other = crossed ? "r4" : "l4";
      Answer a;
      for (const auto& [target, source] : {std::pair{top, leaf}, std::pair{one, other}}) {
        for (const Op op : {Op::latest_xact, Op::latest, Op::latest_common}) {
          a = w.ask(op, target, source);
          CHECK_EQ(a.failure.code, Code::ok);
          CHECK_EQ(a.pose.x, 0);
        }
        // All links have the same stamps, so one at which any has a sample is exact for all.
        const Answer then = w.at(target, source, a.stamp - static_cast<Stamp>(i % 4));
        if (then.failure.code == Code::ok) {
          CHECK_EQ(std::round(then.pose.x), 0);
          past += a.stamp != then.stamp;
        } else {
          CHECK_EQ(then.failure.code, Code::backward);
        }
      }
      const std::vector<Query> queries = {
          w.query(Op::latest_xact, "f0", "f3"),
          w.query(Op::latest_common, "f3", "f8"),
          w.query(Op::latest_xact, "f0", "l4"),
          w.query(Op::latest_xact, "r4", "f0"),
          {Op::full, w.id("f0"), w.id("f8"), kNoStamp, w.id("f5"), kNoStamp}};
      std::vector<Answer> answers(queries.size());
      ReadSet reads;
      w.tree.lookup_transaction(queries, answers, reads);
      CHECK_EQ(answers[0].pose.x + answers[1].pose.x, 0);
      CHECK_EQ(answers[2].pose.x + answers[3].pose.x, 0);
      CHECK_EQ(answers[4].pose.x, 0);
      Answer full;
      w.tree.lookup(queries[4], full);
      CHECK_EQ(full.pose.x, 0);
    }
    CHECK(past > 0);
  });
  threads.join();
  CHECK(z.commits >= 60);
}

// A chain so long, and written so often, that an optimistic read hardly ever succeeds.
TEST_EACH_MODE(a_reader_that_never_wins_is_answered) {
  World w(c);
  constexpr int kLong = 150;
  std::vector<Set> chain;
  for (int i = 1; i <= kLong; ++i) chain.push_back({nth("f", i - 1), nth("f", i), 1, at_x(0)});
  w.accept(chain);
  ThreadGroup threads;
  std::atomic<int> commits{0};
  threads.background(4, [&](int writer, const auto& stop) {
    std::mt19937 random(static_cast<unsigned>(writer));
    for (Stamp stamp = 2; !stop; ++stamp) {
      // Two links at once, which cancel.
      const int i = static_cast<int>(random() % (kLong - 1)), x = static_cast<int>(random() % 100);
      const auto name = [](int n) { return nth("f", n); };
      // In separate halves, so that no two writers undo each other's balance.
      const int a = i / 8 * 8 + 2 * writer, b = a + 1;
      if (b + 1 > kLong) continue;
      w.accept({{name(b), name(b + 1), stamp, at_x(-x)}, {name(a), name(a + 1), stamp, at_x(x)}});
      ++commits;
    }
  });
  threads.foreground([&] {
    for (int i = 0; i < 50 || commits < 100; ++i) {
      const Answer a = w.ask(Op::latest_xact, i % 2 ? "f0" : "f150", i % 2 ? "f150" : "f0");
      CHECK_EQ(a.failure.code, Code::ok);
      CHECK_EQ(a.pose.x, 0);
    }
  });
  threads.join();
}

// Rings that grow and are pruned under lookups at past times. x is the stamp, so that any
// interpolation of true neighbours lies on the line.
TEST_EACH_MODE(past_times_while_rings_grow_and_lose_their_oldest) {
  World w(Options{.cache_ns = 3000, .concurrency = c, .max_samples_per_frame = 512});
  const auto put = [&](const char* parent, const char* child, Stamp t) {
    w.set(parent, child, t, at_x(static_cast<double>(t)));
  };
  for (const Stamp t : {0, 1}) {
    put("a", "b", t);
    put("b", "c", t);
  }
  std::atomic<Stamp> now{1};
  std::atomic<int> lookups{0};
  ThreadGroup threads;
  for (const auto& link : {std::pair{"a", "b"}, std::pair{"b", "c"}})
    threads.background([&, parent = link.first, child = link.second](const auto& stop) {
      std::mt19937 random(static_cast<unsigned>(*child));
      for (int commits = 0; !stop; ++commits) {
        // No faster than the readers: all samples would be gone before they are asked for.
        while (!stop && commits > 5 * lookups + 100) std::this_thread::yield();
        const Stamp t = now += static_cast<Stamp>(random() % 40);
        put(parent, child, t);
        if (random() % 4 == 0) put(parent, child, t - static_cast<Stamp>(random() % 3500));
      }
    });
  threads.foreground(2, [&](int thread) {
    std::mt19937 random(thread);
    int answered = 0;
    // While one writer has no processor, the two links may have no time in common: then on.
    for (int i = 0; i < 3000 || answered < 100; ++i, ++lookups) {
      if (i >= 3000) std::this_thread::yield();
      const Stamp t = now - static_cast<Stamp>(random() % 3500);
      const Answer a = w.at("a", "c", t);
      if (a.failure.code == Code::ok) {
        CHECK_NEAR(a.pose.x, 2 * static_cast<double>(t), 1e-6);
        ++answered;
      } else {
        CHECK(a.failure.code == Code::backward || a.failure.code == Code::forward ||
              a.failure.code == Code::no_data);
        CHECK(a.failure.frame == w.id("b") || a.failure.frame == w.id("c"));
        if (a.failure.code == Code::backward) CHECK(t < a.failure.oldest);
        if (a.failure.code == Code::forward) CHECK(t > a.failure.newest);
      }
      const Answer common = w.ask(Op::latest_common, "c", "a");
      if (common.failure.code == Code::ok)
        CHECK_NEAR(common.pose.x, -2 * static_cast<double>(common.stamp), 1e-6);
    }
  });
  threads.join();
}

// A commit between each read of a frame and its validation: reads of single frames must lock it
// after a bounded number of attempts, and commits must wait for that lock, whatever their locks
// are.
TEST_EACH_MODE(a_frame_that_changes_at_each_attempt_is_read) {
  constexpr int kLimit = 500;
  World w(c);
  std::atomic<int> requested{0}, committed{0};
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    for (Stamp stamp = 1; !stop; ++stamp) {
      while (!stop && committed >= requested) std::this_thread::yield();
      if (stop) return;
      std::vector<Set> sets = {{"f0", "f1", stamp, at_x(1)}};
      if (stamp % 2) sets.push_back({"f1", "f2", stamp, at_x(1)});
      w.accept(sets);
      ++committed;
    }
  });
  threads.foreground([&] {
    // Gives up where the reader has locked the frame, for which the commit waits.
    const std::function<void()> commit_meanwhile = [&] {
      if (requested >= kLimit) return;
      const int goal = ++requested;
      const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(200);
      while (committed < goal && std::chrono::steady_clock::now() < end) std::this_thread::yield();
    };
    commit_meanwhile();
    const FrameId f0 = w.id("f0"), f1 = w.id("f1");
    const auto check_bounded = [&](auto&& read) {
      const int before = requested;
      yield_hook = &commit_meanwhile;
      read();
      yield_hook = nullptr;
      CHECK(requested - before >= SeqLock::kOptimisticReads);
      CHECK(requested - before <= SeqLock::kOptimisticReads + 2);
    };
    check_bounded([&] { CHECK(w.tree.info(f1).newest > 0); });
    check_bounded([&] { CHECK_EQ(w.tree.parent(f1, kNoStamp), f0); });
    while (committed < requested) std::this_thread::yield();
    CHECK_EQ(w.tree.info(f1).version / kVersionStep, static_cast<Version>(committed));
  });
  threads.join();
}
