// Frames are removed and come back, and time is set back, while others read and write.
#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

// A link exists with its parent or not at all: a subtree is removed with its root.
TEST_EACH_MODE(no_link_hangs_on_a_removed_frame) {
  World w(c);
  std::atomic<int> removed{0}, found{0};
  ThreadGroup threads;
  threads.background(2, [&](int writer, const std::atomic<bool>& stop) {
    for (Stamp stamp = 1; !stop; ++stamp) {
      if (writer == 0) w.set("map", "base", stamp, at_x(1));
      w.set("base", "arm", stamp, at_x(1));
    }
  });
  threads.background([&](const std::atomic<bool>& stop) {
    while (!stop) {
      const Answer a = w.ask(Op::latest_xact, "map", "arm");
      if (a.failure.code == Code::ok) {
        CHECK_EQ(a.pose.x, 2.0);
        ++found;
      } else {
        CHECK(a.failure.code == Code::lookup || a.failure.code == Code::connectivity);
      }
    }
  });
  threads.foreground([&] {
    while (removed < 200 || found < 20) {
      if (!w.remove("base", true)) ++removed;
      if (!w.remove("arm")) ++removed;
      if (const auto refused = w.remove("base"))
        CHECK(refused->code == Code::lookup || refused->code == Code::invalid_argument);
      std::this_thread::yield();
    }
  });
  threads.join();
  CHECK(!w.remove("map", true));
  for (const char* name : {"map", "base", "arm"}) {
    const FrameId id = w.id(name);
    CHECK(id == 0 || w.tree.parent(id, kNoStamp) == 0 || w.id("base") != 0);
  }
}

// Two links of one commit are both there, or both gone: a reset is one instant.
TEST_EACH_MODE(a_reset_is_one_instant) {
  World w(c);
  std::atomic<int> found{0}, gone{0};
  ThreadGroup threads;
  threads.background([&](const std::atomic<bool>& stop) {
    for (Stamp stamp = 1; !stop; ++stamp)
      CHECK(!w.commit({{"map", "base", stamp, at_x(1)}, {"base", "arm", stamp, at_x(1)}}));
  });
  threads.background(2, [&](int, const std::atomic<bool>& stop) {
    while (!stop) {
      const Answer a = w.ask(Op::latest_xact, "map", "arm");
      if (a.failure.code == Code::ok) {
        CHECK_EQ(a.pose.x, 2.0);
        ++found;
        continue;
      }
      // Not in one tree: then neither link may exist at the instant of the lookup.
      CHECK(a.failure.code == Code::lookup || a.failure.code == Code::connectivity);
      ++gone;
    }
  });
  threads.foreground([&] {
    for (int resets = 0; resets < 200 || found < 20 || gone < 20; ++resets) {
      w.tree.reset();
      std::this_thread::yield();
    }
  });
  threads.join();
  w.tree.reset();
  for (const char* name : {"map", "base", "arm"}) CHECK_EQ(w.id(name), 0u);
  CHECK(w.set("arm", "map", 1));
  CHECK(w.code(Op::at, "arm", "map", 1) == Code::ok);
  CHECK_EQ(w.id("base"), 0u);
}

// No sample that was acknowledged after a time jump is lost, and no frame is cleared twice for it.
TEST_EACH_MODE(a_jump_back_restarts_each_frame_once) {
  World w(Options{.cache_ns = 100, .concurrency = c, .clear_on_time_jump = true});
  constexpr int kRounds = 200;
  for (int round = 0; round < kRounds; ++round) {
    const Stamp now = -1000 * round;
    ThreadGroup threads;
    threads.foreground(3, [&](int writer) {
      const std::string frame = nth("f", writer);
      CHECK_EQ(w.set("map", frame, now), round == 0);  // the first witness
      CHECK(w.set("map", frame, now + 1));
    });
    // Both know the frame, and see the jump at the same time.
    std::vector<Stamp> stored[2];
    threads.foreground(2, [&](int writer) {
      for (Stamp stamp = now + writer; stamp < now + 20; stamp += 2)
        if (w.set("map", "shared", stamp)) stored[writer].push_back(stamp);
    });
    threads.join();
    CHECK(!stored[0].empty() || !stored[1].empty());
    for (const auto& stamps : stored)
      for (const Stamp stamp : stamps) CHECK(w.code(Op::at, "map", "shared", stamp) == Code::ok);
  }
  CHECK_EQ(w.tree.time_jumps(), 4u * (kRounds - 1));
}
