// Frames are created, reparented and cleared while others look up: the newest parents never form a
// cycle.
#include <random>

#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

// From every frame the newest parents lead to a root.
void check_no_cycle(const World& w) {
  for (FrameId id = 1; id <= w.tree.size(); ++id) {
    FrameId frame = id;
    for (FrameId steps = 0; frame != 0 && steps <= w.tree.size(); ++steps)
      frame = w.tree.parent(frame, kNoStamp);
    CHECK_EQ(frame, 0u);
  }
}

}  // namespace

TEST_EACH_MODE(random_moves_close_no_cycle) {
  World w(c);
  const std::vector<std::string> names = {"root", "a", "b", "c", "d"};
  for (std::size_t i = 1; i < names.size(); ++i) w.set("root", names[i], 0);
  std::atomic<Stamp> clock{0};
  std::atomic<int> moved{0}, refused{0};
  ThreadGroup threads;
  threads.background(3, [&](int thread, const auto& stop) {
    std::mt19937 random(thread);
    while (!stop) {
      std::vector<Set> sets;
      for (std::size_t n = 1 + random() % 2; n > 0; --n) {
        const std::size_t child = 1 + random() % 4;
        std::size_t parent = random() % 4;
        parent += parent >= child;
        sets.push_back({names[parent], names[child], ++clock});
      }
      const Code code = w.refusal(sets);
      CHECK(code == Code::ok || code == Code::invalid_argument);
      code == Code::ok ? ++moved : ++refused;
    }
  });
  threads.foreground(2, [&](int thread) {
    std::mt19937 random(100 + thread);
    for (int i = 0; i < 1500 || moved < 200 || refused < 50; ++i) {
      const std::string& target = names[random() % names.size()];
      const std::string& source = names[random() % names.size()];
      // All are below the root, so a path always exists; in a cycle there would be none.
      for (const Op op : {Op::latest, Op::latest_xact, Op::common_time})
        CHECK_EQ(w.code(op, target, source), Code::ok);
      std::vector<FrameId> chain;
      CHECK_EQ(w.tree.chain(w.query(Op::at, target, source), chain).code, Code::ok);
      CHECK(!chain.empty() && chain.front() == w.id(target) && chain.back() == w.id(source));
      const Code common = w.code(Op::latest_common, target, source);
      CHECK(common == Code::ok || (common >= Code::extrapolation && common <= Code::forward) ||
            common == Code::lookup);  // at a past time there may have been a cycle
    }
  });
  threads.join();
  check_no_cycle(w);
}

// One commit moves c from p to another parent and back, many times. Meanwhile no other commit may
// take the other parent for c's newest one, and set c as the parent of p.
TEST_EACH_MODE(a_move_there_and_back_hides_no_cycle) {
  World w(c);
  w.set("p", "c", 0);
  w.set("elsewhere", "x", 0);
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    for (Stamp stamp = 1; !stop;) {
      std::vector<Set> sets;
      for (int i = 0; i < 300; ++i, ++stamp)
        sets.push_back({i % 2 ? "p" : "elsewhere", "c", stamp});
      w.accept(sets);
    }
  });
  threads.foreground([&] {
    for (int i = 1; i <= 2000; ++i) CHECK_EQ(w.refusal({{"c", "p", i}}), Code::invalid_argument);
  });
  threads.join();
  check_no_cycle(w);
}

// A frame is found by name only once it has its link: a commit shows names and samples at once.
TEST_EACH_MODE(new_frames_come_with_their_links) {
  World w(c);
  w.set("f0", "f1", 1, at_x(1));
  constexpr int kFrames = 600;
  const auto name = [](int i) { return nth("f", i); };
  ThreadGroup threads;
  std::atomic<int> made{1};
  threads.foreground([&] {
    for (int i = 2; i < kFrames; ++i) {
      w.accept({{name(i / 2), name(i), 1, at_x(1)}});
      made = i;
    }
  });
  threads.background(2, [&](int thread, const auto& stop) {
    std::mt19937 random(thread);
    while (!stop) {
      const int known = made, i = 1 + static_cast<int>(random() % static_cast<unsigned>(known + 3));
      const Answer a = w.ask(random() % 2 ? Op::latest_xact : Op::latest, "f0", name(i));
      if (a.failure.code == Code::ok) {
        int depth = 0;
        for (int frame = i; frame > 0; frame /= 2) ++depth;
        CHECK_EQ(a.pose.x, depth);
      } else {
        CHECK_EQ(a.failure.code, Code::lookup);
        CHECK(i > known);
      }
      CHECK_EQ(w.id(nth("nobody", i)), 0u);
    }
  });
  threads.join();
  CHECK_EQ(w.tree.size(), static_cast<std::uint32_t>(kFrames));
}

TEST_EACH_MODE(clearing_is_one_instant) {
  World w(c);
  std::atomic<Stamp> clock{0};
  const auto write = [&] {
    const Stamp stamp = ++clock;
    w.accept({{"a", "b", stamp, at_x(1)}, {"b", "c", stamp, at_x(-1)}});
  };
  write();
  w.set("c", "tool", 0, at_x(5), true);
  ThreadGroup threads;
  threads.background([&](const auto& stop) {
    for (int i = 0; !stop; ++i) {
      write();
      if (i % 3 == 0) w.tree.clear(true);
    }
  });
  threads.foreground([&] {
    int found = 0, missing = 0;
    for (int i = 0; i < 2000 || found < 50 || missing < 50; ++i) {
      const std::vector<Query> queries = {w.query(Op::latest_xact, "a", "b"),
                                          w.query(Op::latest_common, "b", "c"),
                                          w.query(Op::latest_xact, "c", "tool")};
      std::vector<Answer> answers(queries.size());
      ReadSet reads;
      w.tree.lookup_transaction(queries, answers, reads);
      CHECK_EQ(answers[0].failure.code, answers[1].failure.code);
      CHECK_EQ(answers[2].pose.x, 5);
      if (answers[0].failure.code == Code::ok) {
        CHECK_EQ(answers[0].stamp, answers[1].stamp);
        ++found;
      } else {
        CHECK_EQ(answers[0].failure.code, Code::connectivity);
        ++missing;
      }
    }
  });
  threads.join();
}
