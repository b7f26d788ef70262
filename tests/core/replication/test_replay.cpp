// Mirrors that replay a tree's log, or read it as an interest in all frames, have its versions,
// parents and samples after every message.
#include <random>
#include <tuple>

#include "fixture.hpp"
#include "replication/change_replay.hpp"
#include "replication/frame_copy.hpp"
#include "replication/interest_reader.hpp"

using namespace ztf;

namespace {

constexpr std::uint64_t kLogBytes = 1 << 20;

// Everything of a frame that a mirror must have.
std::string state_of(const Tree& tree, const std::string& name) {
  const FrameId id = tree.find(name);
  if (id == 0) return "none";
  const FrameInfo info = tree.info(id);
  const auto named = [&](FrameId parent) { return parent ? tree.name(parent) : std::string("-"); };
  std::ostringstream text;
  text << "version " << (info.version & kServerVersion) << " parent " << named(info.parent)
       << " static " << info.is_static << " authority " << tree.authority(info.authority);
  FrameCopy copy;
  copy.read(tree.state().frames[id], tree.state().edits[id],
            [](std::uint32_t, auto&&) noexcept { return 0u; });
  for (const CopiedSample& sample : copy.samples())
    text << " (" << sample.stamp << ' ' << named(sample.parent) << ' ' << sample.pose.x << ')';
  return text.str();
}

// A tree and two mirrors of it, by its log and by an interest in all frames.
class Mirrored {
 public:
  explicit Mirrored(const Options& options)
      : original(with_log(options)), interest_(original.tree.state(), {}, false) {
    original.tree.change_log()->start();
  }

  World original;

  void follow() {
    const ChangeLog::Taken taken = original.tree.change_log()->take(1 << 20);
    CHECK(!taken.lost);
    if (taken.last >= taken.first)
      ChangeReplay(by_log_.tree.state()).apply(changes_of(taken.entries).view(), taken.last);
    const InterestReader::Result read = interest_.read(false, 1000);
    if (!read.changes.kind.empty())
      ChangeReplay(by_interest_.tree.state()).apply(read.changes.view(), read.seq);
  }
  // Returns whether both are what the original is.
  bool check(const std::string& frame, const char* file = __builtin_FILE(),
             int line = __builtin_LINE()) const {
    const std::string expected = state_of(original.tree, frame);
    bool equal = true;
    for (const World* mirror : {&by_log_, &by_interest_}) {
      const std::string found = state_of(mirror->tree, frame);
      equal &= found == expected;
      if (found != expected)
        check::fail(file, line, frame + ": '" + found + "' instead of '" + expected + "'");
    }
    return equal;
  }

 private:
  static Options with_log(Options options) {
    options.max_log_bytes = kLogBytes;
    return options;
  }

  const Options mirror_options_{
      .cache_ns = original.tree.options().cache_ns,
      .max_frames = 64,
      .max_samples_per_frame = original.tree.options().max_samples_per_frame,
      .clear_on_time_jump = original.tree.options().clear_on_time_jump};
  World by_log_{mirror_options_}, by_interest_{mirror_options_};
  InterestReader interest_;
};

// One random write: mostly rows of some frames, some of them late, as static links or with parents
// that change, else a removal, a clear or a reset.
class RandomWrites {
 public:
  explicit RandomWrites(std::uint64_t seed) : random_(seed) {}

  static constexpr int kNames = 12;
  static std::string name(int n) { return nth("f", n); }

  void write(World& w) {
    const int kind = below(100);
    if (kind < 88)
      commit(w);
    else if (kind < 95)
      (void)w.remove(name(below(kNames)), below(2) != 0);
    else if (kind < 98)
      w.tree.clear(below(2) != 0);
    else if (below(3) == 0)
      w.tree.reset();
  }
  int below(int bound) { return static_cast<int>(random_() % static_cast<unsigned>(bound)); }

 private:
  void commit(World& w) {
    std::vector<Set> sets;
    const int rows = 1 + (below(3) ? 0 : below(24));
    const int only = below(3) == 0 ? below(kNames) : -1;  // a history of one frame
    const bool mostly_one_tree = below(3) != 0;
    for (int i = 0; i < rows; ++i) {
      const int child = only >= 0 ? only : below(kNames);
      int parent =
          mostly_one_tree ? (child + 1) / 2 + (below(6) == 0 ? below(3) : 0) : below(kNames);
      if (parent >= kNames || parent == child) parent = (child + 1) % kNames;
      const Stamp stamp = now_ + below(below(4) ? 6 : 40) - (below(4) ? 0 : 15);
      sets.push_back({name(parent), name(child), stamp, at_x(below(1'000'000))});
    }
    if (below(3) == 0) now_ += below(6);
    if (below(40) == 0) now_ -= 30;
    (void)w.commit(sets, {.authority = below(3) ? nth("authority", below(3)) : std::string(),
                          .is_static = below(8) == 0,
                          .drop_old = below(4) != 0});
  }

  std::mt19937_64 random_;
  Stamp now_ = 0;
};

}  // namespace

// The first reparenting gives all frames a new version: also one whose rows are all too old. With
// another version a mirror's transactions of that frame would conflict until it changes again.
TEST(a_frame_whose_rows_are_dropped_beside_the_first_reparenting_has_one_version) {
  for (const int rows : {1, 3}) {
    Mirrored trees(Options{.cache_ns = 100});
    World& w = trees.original;
    for (const char* frame : {"f", "g"}) w.accept({{"map", frame, 1000}, {"map", frame, 1100}});
    w.accept({{"world", "odom", 1100}, {"world", "map", 1100}});
    trees.follow();
    std::vector<Set> sets{{"odom", "g", 1101}};
    for (int i = 0; i < rows; ++i) sets.push_back({"map", "f", i});
    std::vector<std::uint8_t> stored;
    CHECK(!w.commit(sets, {.drop_old = true}, &stored));
    CHECK(stored[0] == RowResult::stored && stored[1] == RowResult::dropped);
    trees.follow();
    for (const char* frame : {"f", "g", "map", "odom", "world"}) CHECK(trees.check(frame));
  }
}

TEST(mirrors_have_what_random_writes_leave) {
  for (std::uint64_t seed = 1; seed <= 150; ++seed) {
    RandomWrites writes(seed);
    Mirrored trees(Options{.cache_ns = 20,
                           .max_frames = 8,
                           .max_samples_per_frame = 2 + static_cast<std::uint32_t>(seed) % 5,
                           .clear_on_time_jump = seed % 2 == 0});
    for (int step = 0; step < 80; ++step) {
      writes.write(trees.original);
      if (writes.below(3)) continue;
      trees.follow();
      for (int n = 0; n < RandomWrites::kNames; ++n)
        if (!trees.check(RandomWrites::name(n)))
          return check::fail(__FILE__, __LINE__, nth("seed ", seed));
    }
  }
}
