// Rows that are dropped change nothing but counters: only stored rows create names.
#include <memory>

#include "fixture.hpp"
#include "histories/insert.hpp"
#include "records/owned_memory.hpp"

using namespace ztf;

namespace {

constexpr Stamp kSecond = 1'000'000'000;

std::vector<std::string> names_of(const World& w) {
  std::vector<std::string> names;
  for (FrameId id = 1; id <= w.tree.size(); ++id)
    if (!w.tree.removed(id)) names.push_back(w.tree.name(id));
  return names;
}

using Names = std::vector<std::string>;
const SetOptions kDropOld{.drop_old = true};

}  // namespace

TEST_EACH_MODE(a_row_that_is_too_old_creates_no_parent) {
  World w(c);
  w.set("map", "base", 100 * kSecond);
  CHECK(!w.set("ghost", "base", kSecond));
  CHECK(names_of(w) == Names({"base", "map"}));
  CHECK_EQ(w.tree.size(), 2u);
  CHECK_EQ(w.events("base").dropped.load(), 1u);
  CHECK_EQ(w.refusal({{"ghost", "base", kSecond}}), Code::invalid_argument);
  CHECK(w.set("ghost", "base", 101 * kSecond));
  CHECK(names_of(w) == Names({"base", "map", "ghost"}));
}

TEST(a_row_without_room_in_a_full_frame_creates_no_parent) {
  World w(Options{.max_samples_per_frame = 2});
  w.set("map", "base", 5);
  w.set("map", "base", 6);
  CHECK(!w.set("ghost", "base", 4));
  CHECK(names_of(w) == Names({"base", "map"}));
}

TEST(of_a_commit_only_the_stored_rows_create_names) {
  World w;
  w.set("map", "base", 100 * kSecond);
  std::vector<std::uint8_t> stored;
  CHECK(!w.commit({{"ghost", "base", kSecond},
                   {"shared", "base", 2 * kSecond},
                   {"new", "base", 101 * kSecond},
                   {"base", "child", kSecond},
                   {"shared", "other", kSecond}},
                  kDropOld, &stored));
  CHECK(stored == std::vector<std::uint8_t>({0, 0, 1, 1, 1}));
  CHECK_EQ(w.id("ghost"), 0u);
  for (const char* name : {"new", "child", "shared", "other"}) CHECK(w.id(name) != 0);
  CHECK_EQ(w.tree.size(), 6u);  // no id was lost
  CHECK_EQ(w.tree.parent(w.id("base"), kNoStamp), w.id("new"));
  CHECK(w.set("shared", "last", 1));
  CHECK_EQ(w.tree.name(7), "last");
  // What a dropped row would have closed is no cycle.
  CHECK(!w.commit({{"child", "base", kSecond}}, kDropOld));
}

TEST(a_row_from_the_future_creates_no_name) {
  World w;
  w.set("map", "base", 1);
  const std::string_view names[] = {"ghost", "base", "other", "map"};
  const Row rows[] = {{0, 1, 20, {}}, {0, 2, 20, {}}, {3, 1, 5, {}}};
  std::uint8_t stored[3];
  w.tree.commit({.names = names, .rows = rows, .drop_old = true, .max_stamp = 10}, stored);
  CHECK(stored[0] == RowResult::from_future && stored[1] == RowResult::from_future);
  CHECK_EQ(stored[2], RowResult::stored);
  CHECK(names_of(w) == Names({"base", "map"}));
}

TEST(a_dropped_row_does_not_bring_a_removed_name_back) {
  World w;
  w.set("map", "base", 100 * kSecond);
  w.set("map", "gone", 1);
  w.tree.remove_frame("gone", false);
  CHECK(!w.set("gone", "base", kSecond));
  CHECK_EQ(w.id("gone"), 0u);
}

TEST(a_dropped_row_takes_no_place_at_the_limit_of_frames) {
  World w(Options{.max_frames = 3});
  w.set("map", "base", 100 * kSecond);
  CHECK(!w.set("ghost0", "base", kSecond));
  CHECK(!w.commit({{"ghost1", "base", kSecond}, {"map", "last", 1}}, kDropOld));
  CHECK(!w.set("ghost2", "base", kSecond));
  CHECK(names_of(w) == Names({"base", "map", "last"}));
  const auto rejected = w.commit({{"more", "base", 101 * kSecond}}, kDropOld);
  CHECK(rejected && rejected->field == "max_frames" && rejected->frame == "more");
}

// A time jump is decided as before: the second late row is stored, and creates its parent.
TEST(a_late_row_that_begins_the_history_again_creates_its_parent) {
  World w(Options{.clear_on_time_jump = true});
  w.set("map", "base", 100 * kSecond);
  CHECK(!w.set("early", "base", kSecond));
  CHECK_EQ(w.id("early"), 0u);
  CHECK(w.set("early", "base", 2 * kSecond));
  CHECK_EQ(w.tree.parent(w.id("base"), kNoStamp), w.id("early"));
}

TEST(no_counter_of_a_frame_wraps) {
  World w(Options{.max_samples_per_frame = 2});
  w.set("map", "base", 100 * kSecond);
  auto& events = const_cast<FrameEvents&>(w.events("base"));
  constexpr std::uint64_t kMost32 = 0xFFFFFFFF;
  for (auto* counter : {&events.dropped, &events.rewritten, &events.reparented, &events.switched,
                        &events.authority_changes})
    *counter = kMost32;
  CHECK(!w.set("map", "base", kSecond));
  CHECK(w.set("map", "base", 100 * kSecond));
  CHECK(!w.commit({{"odom", "base", 101 * kSecond}}, {.authority = "a"}));
  w.set("odom", "base", 1, {}, true);
  for (const auto* counter :
       {&events.dropped, &events.rewritten, &events.reparented, &events.switched})
    CHECK_EQ(counter->load(), kMost32 + 1);
  CHECK(events.authority_changes > kMost32);
  CHECK_EQ(w.tree.totals().dropped, kMost32 + 1);
}

TEST(the_counter_of_evicted_samples_does_not_wrap) {
  constexpr std::uint64_t kMost32 = 0xFFFFFFFF;
  const HistoryLimits limits{10, 2};
  OwnedArena memory;
  const auto frame = std::make_unique<Frame>();
  PreparedRing prepared = grown_ring(*frame, 2, limits, memory);
  publish_ring(*frame, prepared);
  frame->evicted = kMost32 - 1;
  for (Stamp stamp = 1; stamp <= 4; ++stamp) (void)insert(*frame, stamp, 1, {}, limits);
  CHECK_EQ(frame->evicted.load(), kMost32 + 1);
  static_assert(std::is_same_v<decltype(FrameInfo::evicted), std::uint64_t>);
}
