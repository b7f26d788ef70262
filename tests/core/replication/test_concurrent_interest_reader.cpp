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

// A mirror that one thread brings up to date, by read().
struct Follower : World {
  Follower(World& w, InterestReader::Pairs pairs, bool newest_only)
      : reader(w.tree.state(), std::move(pairs), newest_only), replay(tree.state()) {
    const InterestReader::Result begin = reader.read(true, kMany);
    if (begin.ever_reparented) replay.set_ever_reparented();
    apply(begin.all, begin.seq);
  }
  void read() {
    const InterestReader::Result result = reader.read(false, kMany);
    // A mirror accepts changes only under a number that it does not have yet.
    CHECK(result.changes.kind.empty() ? result.seq >= last : result.seq > last);
    apply(result.changes, result.seq);
  }
  void apply(const ChangeTable& changes, Seq seq) {
    if (!changes.kind.empty()) replay.apply(changes.view(), seq);
    last = seq;
  }

  InterestReader reader;
  ChangeReplay replay;
  Seq last = 0;
};

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
  World w(Options{.concurrency = c, .max_frames = 16, .max_log_bytes = kLogBytes});
  w.set("map", "left", 1, at_x(0), true);
  w.set("map", "right", 1, at_x(0.5), true);
  CHECK(!w.commit(chain(2)));
  CHECK(!w.commit(chain(3)));  // histories have several parents from now on
  Follower mirror(w, {{"map", "c"}, {"map", "missing"}}, false);
  const auto seen_commit = [&] {
    const Answer answer = mirror.ask(Op::latest_xact, "map", "c");
    CHECK_EQ(answer.failure.code, Code::ok);
    return commit_of(answer.pose.x);
  };
  std::atomic<int> newest{3}, seen{0};
  ThreadGroup threads;
  threads.foreground([&] {
    for (int n = 4; n < 3000; ++n) {
      // A far later stamp prunes the samples of the other parent, so that the place leaves.
      std::vector<Set> links = chain(n);
      for (Set& link : links) link.stamp = Stamp{n} * 20'000'000'000;
      CHECK(!w.commit(links));
      newest = n;
    }
  });
  threads.foreground([&] {
    for (int n = 2; n < 3000; ++n) {
      w.set("map", "other", n, at_x(n));
      if (n % 10 == 0) w.tree.remove_frame("other", true);
      const std::string visitor = nth("visitor", n);
      w.set("a", visitor, n, at_x(n));
      w.tree.remove_frame(visitor, false);
    }
  });
  threads.background([&](const std::atomic<bool>& stop) {
    for (int last = 0; !stop;) {
      const int n = seen_commit();
      CHECK(n >= last);
      seen += n != last;
      last = n;
    }
  });
  threads.background([&](const std::atomic<bool>& stop) {
    while (!stop) {
      const int before = newest;
      mirror.read();
      CHECK(seen_commit() >= before);
      CHECK_EQ(mirror.id("other"), FrameId{0});
    }
  });
  threads.join();
  mirror.read();
  CHECK_EQ(seen_commit(), 2999);
  CHECK_EQ(mirror.id("left"), FrameId{0});
  CHECK(mirror.id("right") != 0);
  CHECK(seen > 0);
}

// All frames, newest samples only, while names come and go and their ids pass on.
TEST(newest_samples_of_a_tree_whose_names_pass_on) {
  World w(Options{.max_frames = 24, .max_log_bytes = kLogBytes});
  w.set("map", "base", 1, at_x(1));
  w.set("map", "arm", 1, at_x(1));
  Follower mirror(w, {}, true);
  ThreadGroup threads;
  threads.foreground([&] {
    for (int n = 2; n < 4000; ++n)
      CHECK(!w.commit({{"map", "base", n, at_x(n)}, {"map", "arm", n, at_x(n)}}));
  });
  threads.foreground([&] {
    for (int n = 0; n < 1000; ++n) {
      const std::string name = nth("visitor", n);
      w.set("map", name, 1, at_x(n));
      w.tree.remove_frame(name, false);
    }
  });
  threads.background([&](const std::atomic<bool>& stop) {
    while (!stop) {
      mirror.read();
      CHECK_EQ(mirror.ask(Op::latest_xact, "base", "arm").pose.x, 0.0);
    }
  });
  threads.join();
  mirror.read();
  for (const char* frame : {"base", "arm"}) {
    CHECK_EQ(mirror.ask(Op::latest_xact, "map", frame).pose.x, 3999.0);
    CHECK_EQ(mirror.version(frame), w.version(frame));
  }
  CHECK_EQ(mirror.reader.frames(), std::size_t{3});
}
