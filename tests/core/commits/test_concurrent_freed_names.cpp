// Names are removed, and others get their ids, while others read and write: no lookup finds the
// pose of another name's frame, and no commit writes to one.
#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr int kRounds = 300;

// Looks the names up until they had their ids all the time.
template <class LookUp>
Answer ask(const World& w, const std::string& target, const std::string& source, LookUp&& look_up) {
  for (;;) {
    const Tree::FrameRef t = w.tree.find_ref(target), s = w.tree.find_ref(source);
    Answer a;
    look_up(t.id, s.id, a);
    if (w.tree.is_current(t) && w.tree.is_current(s)) return a;
  }
}

// The commit of round n: all poses in it are n.
std::optional<Rejected> commit(World& w, int n, Stamp stamp) {
  return w.commit({{nth("parent", n), nth("child", n), stamp, at_x(n)}}, {.drop_old = true});
}

// Each round has names and a pose of its own. Threads commit and look up those of the round that
// they saw last, which may have been removed since.
struct Rounds {
  explicit Rounds(Concurrency c) : w(Options{.concurrency = c, .max_frames = 7}) {}

  void check(const Answer& a, int n) {
    if (a.failure.code != Code::ok) return;
    CHECK_EQ(a.pose.x, static_cast<double>(n));
    ++found;
  }
  void write(const std::atomic<bool>& stop) {
    for (Stamp stamp = 2; !stop; ++stamp) {
      const auto refused = commit(w, round, stamp);
      if (!refused)
        ++written;
      else
        CHECK(refused->code == Code::limit || refused->code == Code::invalid_argument);
    }
  }
  void append(const std::atomic<bool>& stop) {
    for (Stamp stamp = 2; !stop; ++stamp) {
      const int n = round;
      const std::vector<NameRef> link{w.tree.find_ref(nth("parent", n)),
                                      w.tree.find_ref(nth("child", n))};
      // Every other time by a new authority, which needs the topology mutex.
      const auto refused =
          w.append(link, stamp, at_x(n), stamp % 2 ? "" : nth("authority", stamp % 1000));
      if (!refused)
        ++appended;
      else
        CHECK_EQ(refused->code, Code::stale_frame);
    }
  }
  void read(const std::atomic<bool>& stop) {
    for (int i = 0; !stop; ++i) {
      const int n = round;
      const std::string parent = nth("parent", n), child = nth("child", n);
      const Op op = i % 3 == 0 ? Op::latest : i % 3 == 1 ? Op::latest_xact : Op::at;
      check(ask(w, parent, child,
                [&](FrameId target, FrameId source, Answer& a) {
                  w.tree.lookup({op, target, source, 1}, a);
                }),
            n);
      check(ask(w, parent, child,
                [&](FrameId target, FrameId source, Answer& a) {
                  const Query q{Op::latest_common, target, source};
                  ReadSet reads;
                  w.tree.lookup_transaction({&q, 1}, {&a, 1}, reads);
                }),
            n);
    }
  }
  void wait(const std::atomic<bool>& stop) {
    while (!stop) {
      const int n = round;
      const std::string parent = nth("parent", n), child = nth("child", n);
      BlockingWaiter waiter(w.tree.state(), {Op::latest_xact, 0, 0}, parent, child);
      if (!waiter.wait(BlockingWaiter::Clock::now() + std::chrono::microseconds(200))) continue;
      check(waiter.answer(), n);
      ++waited;
    }
  }
  void advance() {
    const auto enough = [&] {
      return found >= 50 && waited >= 5 && written >= 50 && appended >= 50;
    };
    for (int n = 1; n <= kRounds || !enough(); ++n) {
      while (const auto refused = commit(w, n, 1)) {
        CHECK_EQ(refused->code, Code::limit);  // others brought older names back
        w.tree.reset();
      }
      round = n;
      if (n % 4 == 0) std::this_thread::yield();
      (void)w.remove(nth("parent", n - 1), true);  // unless it was reset, or never came back
    }
  }

  World w;
  std::atomic<int> round{0}, found{0}, waited{0}, written{0}, appended{0};
};

}  // namespace

TEST_EACH_MODE(no_pose_is_found_under_another_name) {
  Rounds rounds(c);
  ThreadGroup threads;
  threads.background([&](const std::atomic<bool>& stop) { rounds.write(stop); });
  threads.background([&](const std::atomic<bool>& stop) { rounds.append(stop); });
  threads.background([&](const std::atomic<bool>& stop) { rounds.read(stop); });
  threads.background([&](const std::atomic<bool>& stop) { rounds.wait(stop); });
  threads.foreground([&] { rounds.advance(); });
  threads.join();
  CHECK(rounds.w.tree.size() <= 7);
}

// A frame's past parents are removed, and their ids pass to frames that move it elsewhere.
TEST_EACH_MODE(no_past_link_leads_to_the_next_owner_of_an_id) {
  World w(Options{.concurrency = c, .max_frames = 8});
  std::atomic<int> round{0}, found{0}, ended{0};
  ThreadGroup threads;
  threads.background(2, [&](int, const std::atomic<bool>& stop) {
    while (!stop) {
      const int n = round;
      // Past links led from the child over a parent of this round to the root.
      const Answer a = ask(w, "root", "child", [&](FrameId target, FrameId source, Answer& a) {
        w.tree.lookup({Op::at, target, source, 10 * n + 5}, a);
      });
      if (a.failure.code == Code::ok) {
        CHECK_EQ(a.pose.x, static_cast<double>(1000 * n + 1));
        ++found;
      } else {
        ended += a.failure.code == Code::connectivity;
      }
    }
  });
  threads.foreground([&] {
    for (int n = 1; n <= kRounds || found < 20 || ended < 20; ++n) {
      const std::string parent = nth("parent", n);
      const Stamp t = 10 * n;
      CHECK(!w.commit({{"root", parent, 1, at_x(1000 * n)},
                       {"root", parent, 1'000'000'000, at_x(1000 * n)},
                       {parent, "child", t, at_x(1)},
                       {parent, "child", t + 6, at_x(1)}}));
      round = n;
      if (n % 2 == 0) std::this_thread::yield();
      CHECK(!w.commit({{"root", "child", t + 8, at_x(-1)}}));
      w.tree.remove_frame(parent, true);
    }
  });
  threads.join();
  CHECK(w.tree.size() <= 8);
}

// A transaction reads a frame by its name, and writes it with the version that it has read. If the
// frame was removed in between, and its name has come back, under its id or another, it conflicts.
TEST_EACH_MODE(a_read_set_from_before_the_removal_conflicts) {
  World w(Options{.concurrency = c, .max_frames = 5});
  std::atomic<int> conflicts{0}, commits{0};
  std::atomic<Stamp> clock{2};
  w.set("root", "frame", 1, at_x(0));
  ThreadGroup threads;
  threads.background(2, [&](int, const std::atomic<bool>& stop) {
    while (!stop) {
      Answer a;
      ReadSet reads;
      std::vector<std::pair<std::string, Version>> named;
      const Tree::FrameRef root = w.tree.find_ref("root"), frame = w.tree.find_ref("frame");
      const Query q{Op::latest_xact, root.id, frame.id};
      w.tree.lookup_transaction({&q, 1}, {&a, 1}, reads);
      for (const ReadVersion& read : reads)
        named.emplace_back(w.tree.name(read.frame), read.version);
      if (!w.tree.is_current(root) || !w.tree.is_current(frame)) continue;
      if (a.failure.code != Code::ok) continue;
      std::this_thread::yield();
      // Says in which life of the frame it was read.
      const auto refused = w.commit({{"root", "frame", clock++, at_x(a.pose.x)}},
                                    {.drop_old = true, .reads = named});
      if (!refused)
        ++commits;
      else
        conflicts += refused->code == Code::conflict;
    }
  });
  threads.foreground([&] {
    for (int n = 1; n <= kRounds || conflicts < 20 || commits < 20; ++n) {
      w.tree.remove_frame("frame", true);
      for (int i = 0; i < n % 4; ++i) {  // other names take the ids
        CHECK(w.set("root", nth("other", i), 1));
        w.tree.remove_frame(nth("other", i), true);
      }
      CHECK(w.set("root", "frame", clock++, at_x(n)));
      std::this_thread::yield();
      const Answer a = w.ask(Op::latest_xact, "root", "frame");
      CHECK(a.failure.code == Code::ok && a.pose.x == n);  // nobody wrote a former life's pose
    }
  });
  threads.join();
}

// Metrics are made of these sums, to which the counts of names that lose their ids still belong.
TEST(totals_of_events_never_go_back) {
  World w(Options{.max_frames = 7});
  std::atomic<int> reads{0};
  ThreadGroup threads;
  threads.foreground([&] {
    constexpr Stamp kHour = 3'600'000'000'000;
    for (int n = 0; n < 500 || reads < 500; ++n) {
      for (const Stamp stamp : {kHour, kHour, Stamp{1}})  // stored, rewritten, dropped
        CHECK_EQ(w.set("root", nth("child", n), stamp), stamp == kHour);
      w.tree.remove_frame(nth("child", n), false);
    }
  });
  threads.background([&](const std::atomic<bool>& stop) {
    for (TreeTotals last; !stop; ++reads) {
      const TreeTotals now = w.tree.totals();
      CHECK(now.dropped >= last.dropped && now.rewritten >= last.rewritten);
      last = now;
    }
  });
  threads.join();
}
