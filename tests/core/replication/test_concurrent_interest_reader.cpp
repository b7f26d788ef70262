// Mirrors of some frames beside writers: each read is of one instant, and so is each lookup in the
// mirror, also while frames leave the paths and come back.
#include "fixture.hpp"
#include "replication/change_replay.hpp"
#include "replication/interest_reader.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr std::uint64_t kLogBytes = 1 << 20;
constexpr std::size_t kMany = 4096;

void apply(ChangeReplay& replay, const ChangeTable& changes, Seq seq) {
  if (!changes.kind.empty()) replay.apply(changes.view(), seq);
}

// The chain of commit n: three links of length n, to the left of two places or on the right.
std::vector<Set> chain(int n) {
  const double x = n;
  return {
      {n % 2 ? "right" : "left", "a", n, at_x(x)}, {"a", "b", n, at_x(x)}, {"b", "c", n, at_x(x)}};
}

// Returns the number of the commit whose chain this is, or -1.
int commit_of(double x) {
  const int n = static_cast<int>(x / 3);
  return x == 3.0 * n + (n % 2 ? 0.5 : 0) ? n : -1;
}

}  // namespace

// The places never change: the one that the chain leaves comes back with the same version. Names
// lose their ids meanwhile.
TEST_EACH_MODE(a_mirror_of_a_chain_that_moves) {
  World w(Options{.concurrency = c, .max_frames = 16, .max_log_bytes = kLogBytes}), mirror;
  w.set("map", "left", 1, at_x(0), true);
  w.set("map", "right", 1, at_x(0.5), true);
  CHECK(!w.commit(chain(2)));
  CHECK(!w.commit(chain(3)));  // histories have several parents from now on
  InterestReader reader(w.tree.state(), {{"map", "c"}, {"map", "missing"}}, false);
  ChangeReplay replay(mirror.tree.state());
  replay.set_ever_reparented();
  const InterestReader::Result begin = reader.read(true, kMany);
  apply(replay, begin.all, begin.seq);

  std::atomic<bool> done{false};
  std::atomic<int> newest{3};
  ThreadGroup writers;
  writers.foreground([&] {
    for (int n = 4; n < 3000; ++n) {
      // A far later stamp prunes the samples of the other parent, so that the place leaves.
      std::vector<Set> links = chain(n);
      for (Set& link : links) link.stamp = Stamp{n} * 20'000'000'000;
      CHECK(!w.commit(links));
      newest = n;
    }
  });
  writers.foreground([&] {
    for (int n = 2; n < 3000; ++n) {
      w.set("map", "other", n, at_x(n));
      if (n % 10 == 0) w.tree.remove_frame("other", true);
      const std::string visitor = nth("visitor", n);
      w.set("a", visitor, n, at_x(n));
      w.tree.remove_frame(visitor, false);
    }
  });
  std::atomic<int> seen{0};
  std::thread lookups([&] {
    int last = 0;
    while (!done) {
      const Answer answer = mirror.ask(Op::latest_xact, "map", "c");
      CHECK_EQ(answer.failure.code, Code::ok);
      const int n = commit_of(answer.pose.x);
      CHECK(n >= last);
      seen += n != last;
      last = n;
    }
  });
  std::thread follower([&] {
    Seq last = begin.seq;
    while (!done) {
      const int before = newest;
      const InterestReader::Result result = reader.read(false, kMany);
      CHECK(result.seq >= last);
      last = result.seq;
      apply(replay, result.changes, result.seq);
      CHECK(commit_of(mirror.ask(Op::latest_xact, "map", "c").pose.x) >= before);
      CHECK_EQ(mirror.id("other"), FrameId{0});
    }
  });
  writers.join();
  done = true;
  lookups.join();
  follower.join();
  const InterestReader::Result end = reader.read(false, kMany);
  apply(replay, end.changes, end.seq);
  CHECK_EQ(commit_of(mirror.ask(Op::latest_xact, "map", "c").pose.x), 2999);
  CHECK_EQ(mirror.id("left"), FrameId{0});
  CHECK(mirror.id("right") != 0);
  CHECK(seen > 0);
}

// All frames, newest samples only, while names come and go and their ids pass on.
TEST(newest_samples_of_a_tree_whose_names_pass_on) {
  World w(Options{.max_frames = 24, .max_log_bytes = kLogBytes}), mirror;
  w.set("map", "base", 1, at_x(1));
  w.set("map", "arm", 1, at_x(1));
  InterestReader reader(w.tree.state(), {}, true);
  ChangeReplay replay(mirror.tree.state());
  const InterestReader::Result begin = reader.read(true, kMany);
  apply(replay, begin.all, begin.seq);
  std::atomic<bool> done{false};
  ThreadGroup writers;
  writers.foreground([&] {
    for (int n = 2; n < 4000; ++n)
      CHECK(!w.commit({{"map", "base", n, at_x(n)}, {"map", "arm", n, at_x(n)}}));
  });
  writers.foreground([&] {
    for (int n = 0; n < 1000; ++n) {
      const std::string name = nth("visitor", n);
      w.set("map", name, 1, at_x(n));
      w.tree.remove_frame(name, false);
    }
  });
  std::thread follower([&] {
    while (!done) {
      const InterestReader::Result result = reader.read(false, kMany);
      apply(replay, result.changes, result.seq);
      CHECK_EQ(mirror.ask(Op::latest_xact, "base", "arm").pose.x, 0.0);
    }
  });
  writers.join();
  done = true;
  follower.join();
  const InterestReader::Result end = reader.read(false, kMany);
  apply(replay, end.changes, end.seq);
  for (const char* frame : {"base", "arm"}) {
    CHECK_EQ(mirror.ask(Op::latest_xact, "map", frame).pose.x, 3999.0);
    CHECK_EQ(mirror.version(frame), w.version(frame));
  }
  CHECK_EQ(reader.frames(), std::size_t{3});
}
