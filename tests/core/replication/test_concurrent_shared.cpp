// Readers of a mapped tree against writers of its owner: every read is one state of the tree.
#include <random>

#include "fixture.hpp"
#include "shared/shared_tree.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr int kLinks = 6;
constexpr std::int64_t kLong = 3'600'000'000'000;  // ns

// Two arms of one root, all links with the commit's number as x: the sum over both is 0.
std::vector<Set> arms(int commit, Stamp stamp) {
  std::vector<Set> sets;
  for (const std::string arm : {"l", "r"})
    for (int i = 1; i <= kLinks; ++i)
      sets.push_back({i == 1 ? "root" : nth(arm, i - 1), nth(arm, i), stamp, at_x(commit)});
  return sets;
}

}  // namespace

TEST_EACH_MODE(a_mapped_tree_never_shows_a_torn_state) {
  World world(Options{.cache_ns = 1'000'000,
                      .concurrency = c,
                      .max_samples_per_frame = 64,
                      .max_memory_bytes = 1 << 24,
                      .shared = true});
  world.accept(arms(0, 0));
  world.tree.begin_lease(kLong);
  const SharedTree tree(world.tree.descriptor());
  const std::string left = nth("l", kLinks), right = nth("r", kLinks);
  const FrameId root = tree.find("root"), l = tree.find(left), r = tree.find(right);

  ThreadGroup threads;
  std::atomic<int> commits{0}, answered{0};
  // Grows and replaces rings, merges late rows, and makes and removes frames.
  threads.background([&](const std::atomic<bool>& stop) {
    std::mt19937 random(1);
    for (int n = 1; !stop; ++n) {
      world.accept(arms(n, n * 10));
      if (n % 7 == 0) world.set("root", nth("passing", n % 3), n);
      if (n % 7 == 3) (void)world.remove(nth("passing", random() % 3));
      if (n % 101 == 0) world.tree.clear(false), world.accept(arms(n, n * 10));
      commits = n;
    }
  });
  threads.foreground(2, [&](int thread) {
    for (int i = 0; i < 1500 || commits < 300; ++i) {
      Query queries[] = {{Op::latest_xact, root, l}, {Op::latest_xact, root, r}};
      Answer answers[2];
      ReadSet reads;
      try {
        if (i % 2 == thread) {
          tree.lookup_transaction(queries, answers, reads);
          if (answers[0].failure.code != Code::ok) continue;  // between clear() and the commit
          CHECK_EQ(answers[0].pose.x, answers[1].pose.x);
          CHECK_EQ(answers[0].stamp, answers[1].stamp);
        } else {
          tree.lookup({i % 3 ? Op::latest_common : Op::latest_xact, r, l}, answers[0]);
          if (answers[0].failure.code != Code::ok) continue;
          CHECK_EQ(answers[0].pose.x, 0.0);
        }
        ++answered;
      } catch (const Unanswered& why) {
        CHECK_EQ(why.reason, Unanswered::Reason::busy);
      }
    }
  });
  threads.join();
  CHECK(answered > 300);
}

TEST(names_are_found_while_their_table_grows) {
  World world(Options{.max_memory_bytes = 1 << 24, .shared = true});
  world.tree.begin_lease(kLong);
  const SharedTree tree(world.tree.descriptor());
  const auto name_of = [](int n) { return std::string(n % 2 ? 0 : 40, 'x') + nth("frame", n); };
  std::atomic<int> done{0};
  ThreadGroup threads;
  threads.foreground([&] {
    for (int n = 1; n <= 2000; ++n) {
      world.set(name_of(0), name_of(n), 1, at_x(n));
      done = n;
    }
  });
  threads.background([&](const std::atomic<bool>& stop) {
    std::minstd_rand random(5);
    while (!stop) {
      const int most = done;
      if (most == 0) continue;
      const int n = 1 + static_cast<int>(random() % static_cast<unsigned>(most));
      const FrameId id = tree.find(name_of(n));
      CHECK(id != 0);
      CHECK(tree.name(id) == name_of(n));
      Answer answer;
      tree.lookup({Op::latest_xact, tree.find(name_of(0)), id}, answer);
      CHECK_EQ(answer.failure.code, Code::ok);
      CHECK_EQ(answer.pose.x, static_cast<double>(n));
    }
  });
  threads.join();
}

TEST(a_mapped_tree_is_read_while_its_file_grows) {
  constexpr int kFrames = 300;
  World world(Options{.cache_ns = 1'000'000'000, .max_memory_bytes = 1 << 26, .shared = true});
  world.accept({{"root", "frame0", 1, at_x(0)}});
  world.tree.begin_lease(kLong);
  const SharedTree tree(world.tree.descriptor());  // of the small file
  std::atomic<int> done{0};
  ThreadGroup threads;
  threads.foreground([&] {
    for (int n = 1; n <= kFrames; ++n) {
      std::vector<Set> sets;
      for (Stamp stamp = 1; stamp <= 500; ++stamp)  // 32 kB
        sets.push_back({"root", nth("frame", n), stamp, at_x(n)});
      world.accept(sets);
      done = n;
    }
  });
  threads.background(2, [&](int, const std::atomic<bool>& stop) {
    while (!stop) {
      const int n = done;
      Answer answer;
      try {
        tree.lookup({Op::at, tree.find("root"), tree.find(nth("frame", n)), 1}, answer);
        CHECK_EQ(answer.failure.code, Code::ok);
        CHECK_EQ(answer.pose.x, static_cast<double>(n));
      } catch (const Unanswered& why) {
        CHECK_EQ(why.reason, Unanswered::Reason::busy);
      }
    }
  });
  threads.join();
}
