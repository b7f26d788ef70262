// Batches of many times against writers: no row ever mixes two commits.
#include "lookups/histories.hpp"
#include "thread_group.hpp"

using namespace ztf;

TEST_EACH_MODE(rows_never_mix_commits) {
  World w(c);
  std::mt19937 random(1);
  w.accept(zero_sums(random));
  std::atomic<int> commits{0};
  ThreadGroup threads;
  threads.background(2, [&](int i, const auto& stop) {
    std::mt19937 own(i + 2);
    for (; !stop; ++commits) {
      if (commits % 4 == 0) {  // one sample only: readers now and then get through in a block
        const Stamp t = static_cast<Stamp>(own() % kSamples) * kStep;
        std::vector<Set> sets;
        for (Set& set : zero_sums(own))
          if (set.stamp == t) sets.push_back(set);
        w.accept(sets);
        std::this_thread::yield();
      } else {
        w.accept(zero_sums(own));
      }
    }
  });
  threads.foreground(2, [&](int thread) {
    std::mt19937 own(static_cast<unsigned>(thread) + 10);
    for (int i = 0; i < 60 || commits < 200; ++i) {
      const bool crossed = (i + thread) % 2;
      std::vector<Query> queries;
      for (int row = 0; row < 150; ++row)
        queries.push_back(w.query(Op::at, crossed ? "f4" : "f0", crossed ? "f0" : "f4",
                                  static_cast<Stamp>(own() % ((kSamples - 1) * kStep))));
      if (i % 3 != 0)
        std::sort(queries.begin(), queries.end(),
                  [](const Query& a, const Query& b) { return a.stamp < b.stamp; });
      std::vector<Answer> answers(queries.size());
      w.tree.lookup_batch(queries, answers);
      for (const Answer& a : answers) {
        CHECK_EQ(a.failure.code, Code::ok);
        CHECK_NEAR(a.pose.x, 0, 1e-9);
      }
    }
  });
  threads.join();
  CHECK(commits >= 200);
}

// Rings grow and lose their oldest, and a link changes sides. x is the stamp, on either side.
TEST_EACH_MODE(rows_while_rings_turn_and_parents_change) {
  World w(Options{.cache_ns = 3000, .concurrency = c, .max_samples_per_frame = 512});
  const auto put = [&](const char* parent, const char* child, Stamp t) {
    w.set(parent, child, t, at_x(static_cast<double>(t)));
  };
  for (const Stamp t : {0, 1}) {
    put("a", "b", t);
    put("b", "c", t);
  }
  w.set("a", "left", 0, {}, true);
  w.set("a", "right", 0, {}, true);
  std::atomic<Stamp> now{1};
  std::atomic<int> rows_answered{0};
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    std::mt19937 random(1);
    for (int commits = 0; !stop; ++commits) {
      // No faster than the readers: all samples would be gone before they are asked for.
      while (!stop && commits > rows_answered / 8 + 100) std::this_thread::yield();
      const Stamp t = now += 1 + static_cast<Stamp>(random() % 40);
      put(random() % 16 ? "a" : random() % 2 ? "left" : "right", "b", t);
      put("b", "c", t);
      if (random() % 4 == 0) put("b", "c", t - static_cast<Stamp>(random() % 3500));
    }
  });
  threads.foreground(2, [&](int thread) {
    std::mt19937 random(thread);
    int answered = 0;
    for (int i = 0; i < 200 || answered < 2000; ++i) {
      std::vector<Query> queries;
      for (int row = 0; row < 100; ++row)
        queries.push_back(
            w.query(Op::at, "a", "c", now - 2000 + 20 * row + static_cast<Stamp>(random() % 20)));
      std::vector<Answer> answers(queries.size());
      w.tree.lookup_batch(queries, answers);
      for (std::size_t row = 0; row < queries.size(); ++row) {
        const Answer& a = answers[row];
        const Stamp t = queries[row].stamp;
        if (a.failure.code == Code::ok) {
          ++answered;
          // Up to a new parent's first sample the older one stands: at most 40 behind.
          CHECK(a.pose.x <= 2 * static_cast<double>(t) + 1e-6);
          CHECK(a.pose.x >= 2 * static_cast<double>(t) - 41);
        } else {
          CHECK(a.failure.code == Code::backward || a.failure.code == Code::forward ||
                a.failure.code == Code::no_data);
        }
        ++rows_answered;
      }
    }
  });
  threads.join();
}
