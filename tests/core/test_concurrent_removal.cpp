// Frames are removed and come back, and time is set back, while others read and write.
#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

std::optional<Rejected> remove(World& w, std::string_view name, bool subtree = false) {
  try {
    w.tree.remove_frame(name, subtree);
  } catch (Rejected& refused) {
    return std::move(refused);
  }
  return std::nullopt;
}

}  // namespace

// A link exists with its parent or not at all: a subtree is removed with its root.
TEST(no_link_hangs_on_a_removed_frame) {
  for_each_concurrency([](Concurrency c) {
    World w(c);
    std::atomic<int> removed{0}, found{0};
    ThreadGroup threads;
    for (int writer = 0; writer < 2; ++writer)
      threads.background([&, writer](const std::atomic<bool>& stop) {
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
        if (!remove(w, "base", true)) ++removed;
        if (!remove(w, "arm")) ++removed;
        if (const auto refused = remove(w, "base"))
          CHECK(refused->code == Code::lookup || refused->code == Code::invalid_argument);
        std::this_thread::yield();
      }
    });
    threads.join();
    CHECK(!remove(w, "map", true));
    for (const char* name : {"map", "base", "arm"}) {
      const FrameId id = w.id(name);
      CHECK(id == 0 || w.tree.parent(id, kNoStamp) == 0 || w.id("base") != 0);
    }
  });
}

// Two links of one commit are both there, or both gone: a reset is one instant.
TEST(a_reset_is_one_instant) {
  for_each_concurrency([](Concurrency c) {
    World w(c);
    std::atomic<int> found{0}, gone{0};
    ThreadGroup threads;
    threads.background([&](const std::atomic<bool>& stop) {
      for (Stamp stamp = 1; !stop; ++stamp)
        CHECK(!w.commit({{"map", "base", stamp, at_x(1)}, {"base", "arm", stamp, at_x(1)}}));
    });
    for (int reader = 0; reader < 2; ++reader)
      threads.background([&](const std::atomic<bool>& stop) {
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
  });
}

// No commit that was acknowledged after the time jump is lost.
TEST(a_jump_back_is_cleared_once) {
  for_each_concurrency([](Concurrency c) {
    World w(Options{.cache_ns = 100, .concurrency = c, .clear_on_time_jump = true});
    for (int round = 0; round < 200; ++round) {
      const Stamp now = -1000 * round;
      ThreadGroup threads;
      for (int writer = 0; writer < 3; ++writer)
        threads.foreground([&, writer] { CHECK(w.set("map", "f" + std::to_string(writer), now)); });
      // All three know the frame, and see the jump at the same time.
      for (int writer = 0; writer < 2; ++writer)
        threads.foreground([&, writer] { CHECK(w.set("map", "shared", now + writer)); });
      threads.join();
      CHECK(w.code(Op::at, "map", "shared", now) == Code::ok);
      CHECK(w.code(Op::at, "map", "shared", now + 1) == Code::ok);
    }
    CHECK(w.tree.time_jumps() >= 199);
  });
}
