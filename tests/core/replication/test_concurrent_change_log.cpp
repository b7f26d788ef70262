// The change log under concurrent writers: its order, and mirrors that follow it.
#include <functional>
#include <map>

#include "fixture.hpp"
#include "replication/change_replay.hpp"
#include "replication/snapshot.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr std::uint64_t kLogBytes = 64 << 20;
const char* const kFrames[] = {"a", "b", "c", "d"};

// Starts the log, and calls visit(entries, last) in a thread for what comes, until join(), which
// returns when nothing is left.
class Follower {
 public:
  using Visit = std::function<void(std::vector<LogEntryPtr>&, Seq)>;
  Follower(ChangeLog& log, Visit visit)
      : thread_([this, &log, position = log.start(), visit = std::move(visit)] {
          follow(log, position, visit);
        }) {}
  void join() {
    done_ = true;
    thread_.join();
  }

 private:
  void follow(ChangeLog& log, Seq position, const Visit& visit) {
    for (;;) {
      const bool is_last = done_;
      log.wait(ChangeLog::Clock::now() + std::chrono::milliseconds(1));
      ChangeLog::Taken taken = log.take(1 << 16);
      CHECK(!taken.lost);
      CHECK_EQ(taken.first, position + 1);
      position = taken.last;
      if (!taken.entries.empty()) visit(taken.entries, taken.last);
      if (is_last && position == log.last_drawn()) return;
      if (taken.lost) return;
    }
  }

  std::atomic<bool> done_{false};
  std::thread thread_;
};

// Calls pause() before each piece.
void load_snapshot(Tree& from, Tree& to, const std::function<void()>& pause = [] {}) {
  SnapshotReader reader(from.state());
  ChangeReplay replay(to.state());
  const SnapshotPlan plan = reader.plan(256);
  if (plan.ever_reparented) replay.set_ever_reparented();
  for (std::size_t i = 1; i < plan.bounds.size(); ++i) {
    pause();
    replay.load(reader.read(plan.bounds[i - 1], plan.bounds[i], 1 << 20).frames.view());
  }
}

}  // namespace

// Each commit says which version it has read of another frame. In the order of the log, that is
// the version which the frame has then. So the order is a serial order.
TEST_EACH_MODE(the_numbers_are_a_serial_order) {
  World w(Options{.concurrency = c, .max_log_bytes = kLogBytes});
  for (const char* frame : kFrames) w.set("map", frame, 1);
  std::map<std::string, double, std::less<>> versions;
  for (const char* frame : kFrames) versions[frame] = static_cast<double>(w.version(frame));
  Follower follower(*w.tree.change_log(), [&](std::vector<LogEntryPtr>& entries, Seq) {
    for (const LogEntryPtr& entry : entries) {
      for (const Change& change : *entry)
        CHECK_EQ(versions.find(entry->authority())->second, change.pose.x);
      for (const Change& change : *entry) {
        double& version = versions.find(entry->name(change.frame))->second;
        CHECK(static_cast<double>(change.version) > version);
        version = static_cast<double>(change.version);
      }
    }
  });

  std::atomic<Stamp> clock{1};
  std::atomic<int> conflicts{0};
  ThreadGroup threads;
  for (unsigned seed = 1; seed <= 3; ++seed)
    threads.foreground([&, seed] {
      std::minstd_rand random(seed);
      for (int i = 0; i < 3000; ++i) {
        const std::string read = kFrames[random() % 4], written = kFrames[random() % 4];
        const std::string second = kFrames[random() % 4];
        // As a reader sees it, who waits for a write that is in progress.
        const Version version = w.version(read) & ~SeqLock::kWriting;
        const Pose pose = at_x(static_cast<double>(version));
        std::vector<Set> sets{{"map", written, ++clock, pose}};
        if (i % 2 == 0 && second != written) sets.push_back({"map", second, ++clock, pose});
        if (w.commit(sets, {.authority = read, .drop_old = true, .reads = {{read, version}}}))
          ++conflicts;
      }
    });
  threads.join();
  follower.join();
  for (const char* frame : kFrames)
    CHECK_EQ(versions[frame], static_cast<double>(w.version(frame)));
  CHECK(conflicts > 0);
}

// A past parent that was removed has a name in the mirror, but no reader finds it: not even in the
// moment in which the name is added.
TEST(a_name_that_was_removed_is_never_found_in_a_mirror) {
  World mirror;
  ChangeReplay replay(mirror.tree.state());
  int looked = 0;
  const std::function<void()> look = [&] {
    ++looked;
    CHECK_EQ(mirror.id("removed"), FrameId{0});
  };
  const std::vector<std::string_view> names{"child", "removed"}, authorities{""};
  const std::vector<ChangeKind> kind{ChangeKind::sample};
  const std::vector<std::uint32_t> frame{0}, parent{1}, authority{0};
  const std::vector<Version> version{4};
  const std::vector<Stamp> stamp{1};
  const std::vector<Pose> pose{at_x(1)};
  yield_hook = &look;
  replay.apply({names, authorities, kind, frame, version, parent, authority, stamp, pose, {}}, 1);
  yield_hook = nullptr;
  CHECK(looked > 2);
  CHECK_EQ(mirror.tree.parent(mirror.id("child"), kNoStamp), FrameId{2});
  CHECK_EQ(mirror.tree.name(2), std::string("removed"));
}

// A snapshot may be read after a commit that is replayed later. One of its rows pruned another, so
// the frame would change if it were stored again; and a reader would not notice, as the version is
// the same.
TEST(a_change_that_the_snapshot_has_is_not_applied_again) {
  const Options few{.cache_ns = 100, .max_samples_per_frame = 4, .max_log_bytes = kLogBytes};
  World w(few), mirror(few);
  ChangeLog& log = *w.tree.change_log();
  const Seq start = log.start();
  CHECK(!w.commit({{"map", "base", 1, at_x(1)}, {"map", "base", 1000, at_x(2)}}));
  std::vector<Set> many;
  for (Stamp stamp = 1; stamp <= 6; ++stamp) many.push_back({"map", "full", stamp, at_x(3)});
  CHECK(!w.commit(many));
  load_snapshot(w.tree, mirror.tree);
  const auto version = [&](const char* frame) { return mirror.version(frame); };
  const Version base = version("base"), full = version("full");
  ChangeLog::Taken taken = log.take(1 << 20);
  CHECK(taken.first == start + 1 && !taken.lost);
  ChangeReplay(mirror.tree.state()).apply(changes_of(taken.entries).view(), taken.last);
  CHECK(version("base") == base && version("full") == full);
  for (const char* frame : {"base", "full"}) {
    const FrameInfo theirs = w.info(frame), ours = mirror.info(frame);
    CHECK_EQ(ours.samples, theirs.samples);
    CHECK_EQ(ours.oldest, theirs.oldest);
    CHECK_EQ(ours.evicted, FrameInfo{}.evicted);
  }
  CHECK_EQ(mirror.tree.replayed(), taken.last);
}

// A mirror's readers see a message as a whole: two links that always move together.
TEST(a_mirror_changes_at_one_instant) {
  World w(Options{.max_log_bytes = kLogBytes}), mirror;
  w.set("map", "base", 1, at_x(0));
  w.set("base", "arm", 1, at_x(0));
  ChangeReplay replay(mirror.tree.state());
  Follower follower(*w.tree.change_log(), [&](const std::vector<LogEntryPtr>& entries, Seq last) {
    replay.apply(changes_of(entries).view(), last);
  });
  load_snapshot(w.tree, mirror.tree);
  std::atomic<int> seen{0};
  ThreadGroup threads;
  threads.foreground([&] {
    std::minstd_rand random(7);
    for (Stamp stamp = 2; stamp < 3000 || seen < 100; ++stamp) {
      const auto x = static_cast<double>(random() % 1000);
      CHECK(!w.commit({{"map", "base", stamp, at_x(x)}, {"base", "arm", stamp, at_x(-x)}}));
      if (stamp % 500 == 0) w.tree.clear(true);
    }
  });
  threads.background(2, [&](int, const std::atomic<bool>& stop) {
    while (!stop) {
      const Answer a = mirror.ask(Op::latest_xact, "map", "arm");
      if (a.failure.code != Code::ok) continue;
      CHECK_EQ(a.pose.x, 0.0);
      ++seen;
    }
  });
  threads.join();
  follower.join();
  for (const char* frame : {"base", "arm"}) {
    CHECK_EQ(mirror.version(frame), w.version(frame));
    CHECK_EQ(mirror.info(frame).samples, w.info(frame).samples);
  }
}

// Moves frames, which come and go with visitors, until the test stops it; counts its rounds.
static void move_frames(World& w, unsigned seed, const std::atomic<bool>& stop,
                        std::atomic<int>& rounds) {
  std::minstd_rand random(seed);
  for (Stamp stamp = 1; !stop; ++stamp, ++rounds) {
    const std::string child = kFrames[random() % 4];
    const std::string visitor = nth("visitor", random() % 16);
    const std::string parent = random() % 4 == 0 ? "odom" : random() % 4 == 0 ? visitor : "map";
    (void)w.commit({{parent, child, stamp, at_x(1)}}, {.drop_old = true});
    if (parent == visitor) (void)w.commit({{"map", child, ++stamp, at_x(1)}}, {.drop_old = true});
    if (random() % 2 == 0)  // unless it is a parent just now
      (void)w.remove(nth("visitor", random() % 16));
    if (random() % 128 == 0) (void)w.remove(child, true);
    if (random() % 512 == 0) w.tree.reset();
  }
}

static void check_equal(const World& mirror, const World& w, const char* frame) {
  const FrameId theirs = w.id(frame), ours = mirror.id(frame);
  CHECK_EQ(theirs == 0, ours == 0);
  if (theirs == 0 || ours == 0) return;
  const FrameInfo info = w.tree.info(theirs);
  CHECK_EQ(mirror.tree.version(ours), w.tree.version(theirs));
  CHECK_EQ(mirror.tree.info(ours).samples, info.samples);
  const auto check_parents = [&](Stamp stamp) {
    CHECK_EQ(mirror.tree.name(mirror.tree.parent(ours, stamp)),
             w.tree.name(w.tree.parent(theirs, stamp)));
  };
  check_parents(kNoStamp);
  if (info.samples != 0)
    for (Stamp stamp = info.oldest; stamp <= info.newest; ++stamp) check_parents(stamp);
}

// Snapshots are taken while frames come and go, and at the limit of frames, so that names lose
// their ids and samples their past parents. Each, with the changes after it, is the tree.
TEST(a_snapshot_among_writers_becomes_the_tree) {
  World w(Options{.max_frames = 16, .max_log_bytes = kLogBytes});
  std::vector<std::pair<std::vector<LogEntryPtr>, Seq>> taken;
  std::vector<std::unique_ptr<World>> mirrors;
  std::atomic<int> rounds{0};
  ThreadGroup threads;
  Follower follower(*w.tree.change_log(), [&](std::vector<LogEntryPtr>& entries, Seq last) {
    taken.emplace_back(std::move(entries), last);
  });
  threads.background(
      2, [&](int seed, const std::atomic<bool>& stop) { move_frames(w, seed + 1, stop, rounds); });
  threads.foreground([&] {
    for (int i = 0; i < 20; ++i) {
      mirrors.push_back(std::make_unique<World>());
      load_snapshot(w.tree, mirrors.back()->tree, [&] {  // long enough that ids are freed
        for (const int before = rounds; rounds < before + 40;) std::this_thread::yield();
      });
    }
  });
  threads.join();
  follower.join();
  std::size_t orphans = 0;
  for (const auto& mirror : mirrors) {
    ChangeReplay replay(mirror->tree.state());
    for (const auto& [entries, last] : taken) {
      const ChangeTable changes = changes_of(entries);
      orphans += changes.lost.size();
      replay.apply(changes.view(), last);
    }
    for (const char* frame : {"map", "odom", "a", "b", "c", "d"}) check_equal(*mirror, w, frame);
  }
  CHECK(orphans > 0);
}

TEST(a_wake_before_the_wait_ends_it) {
  World w(Options{.max_log_bytes = kLogBytes});
  ChangeLog& log = *w.tree.change_log();
  (void)log.start();
  using namespace std::chrono_literals;
  log.wake();
  log.wait(ChangeLog::Clock::now() + 1h);
  log.wake();
  log.wait(ChangeLog::Clock::now() + 1h);
  log.wait(ChangeLog::Clock::now());  // without one, until the deadline
}
