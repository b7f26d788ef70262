// What the newest links may be: no cycle, and no frame that is put too deep.
#include <algorithm>
#include <map>
#include <random>

#include "fixture.hpp"

using namespace ztf;

namespace {

std::vector<Set> chain(const std::string& root, const std::string& prefix, int links,
                       Stamp stamp = 1) {
  std::vector<Set> sets;
  for (int i = 1; i <= links; ++i)
    sets.push_back({i == 1 ? root : nth(prefix, i - 1), nth(prefix, i), stamp});
  return sets;
}

std::uint32_t depth_of(const World& w, FrameId frame) {
  std::uint32_t depth = 0;
  while ((frame = w.tree.parent(frame, kNoStamp)) != 0) ++depth;
  return depth;
}

}  // namespace

TEST(a_frame_that_would_be_too_deep_is_named) {
  World w(Options{.max_depth = 10});
  w.accept(chain("root", "a", 10));
  w.accept(chain("top", "b", 4));
  const auto rejected = w.commit({{"a10", "top", 2}});
  CHECK(rejected);
  if (!rejected) return;
  CHECK_EQ(rejected->code, Code::limit);
  CHECK_EQ(rejected->field, "max_depth");
  CHECK_EQ(rejected->frame, "top");
  CHECK_EQ(rejected->limit, 10);
  CHECK_EQ(w.refusal(chain("x", "new", 11)), Code::limit);
  CHECK_EQ(w.id("new1"), 0u);
  // What counts is the tree after the commit, whatever comes first.
  w.accept({{"a3", "top", 3}});
  w.accept({{"b1", "root", 4}, {"other", "top", 4}, {"root2", "a1", 4}});
}

// The lookups of a frame that its parent takes too deep say so, and a write below it is refused.
TEST(frames_below_one_that_moves_may_be_too_deep) {
  World w(Options{.max_depth = 3});
  w.accept(chain("root", "a", 3));
  w.accept(chain("top", "b", 2));
  w.accept({{"a2", "top", 2}});
  CHECK_EQ(w.code(Op::latest_xact, "root", "b2"), Code::lookup);
  CHECK_EQ(w.code(Op::latest_xact, "a2", "b2"), Code::ok);
  CHECK_EQ(w.refusal({{"b2", "new", 3}}), Code::limit);
  w.accept({{"b1", "b2", 3}});  // the same parent again
  w.accept({{"other", "top", 3}});
  CHECK_EQ(w.code(Op::latest_xact, "other", "b2"), Code::ok);
}

// A frame that is at the limit is not too deep.
TEST(of_several_frames_the_first_that_is_too_deep_is_named) {
  World w(Options{.max_depth = 3});
  w.accept(chain("root", "a", 2));
  w.set("x", "first", 1);
  w.set("x", "second", 1);
  const auto rejected = w.commit({{"up", "first", 2}, {"up", "second", 2}, {"a2", "up", 2}});
  CHECK(rejected && rejected->frame == "first");
  const auto other = w.commit({{"a2", "first", 2}, {"up", "second", 2}, {"a2", "up", 2}});
  CHECK(other && other->frame == "second");
}

TEST(a_chain_at_the_limit_can_be_reversed) {
  World w(Options{.max_depth = 10});
  w.accept(chain("a0", "a", 10));
  std::vector<Set> reversed;
  for (int i = 1; i <= 10; ++i) reversed.push_back({nth("a", i), nth("a", i - 1), 2});
  w.accept({{"top", "a10", 3}});  // a10 is alone at first
  reversed.push_back({"top", "a10", 3});
  CHECK_EQ(w.refusal(reversed), Code::limit);  // a0 would be 11 below top
  reversed.erase(reversed.begin());
  w.accept(reversed);
}

TEST(frames_that_swap_places_for_ever_are_never_refused) {
  World w(Options{.max_depth = 3});
  w.set("root", "a", 1);
  w.set("root", "b", 1);
  for (Stamp t = 2; t < 200; t += 2) {
    w.accept({{"a", "b", t}});
    w.accept({{"root", "b", t + 1}, {"b", "a", t + 1}});
    w.accept({{"root", "a", t + 1}});
  }
}

// And in no other case: a commit may take frames too deep that it does not link itself.
TEST(random_changes_are_refused_if_a_child_would_be_too_deep) {
  std::mt19937 random(7);
  for (int round = 0; round < 30; ++round) {
    const std::uint32_t limit = 2 + random() % 4;
    World w(Options{.max_depth = limit});
    for (Stamp t = 1; t < 150; ++t) {
      std::vector<Set> sets;
      for (std::size_t i = 1 + random() % 3; i > 0; --i) {
        const auto parent = random() % 12, child = random() % 12;
        if (parent != child)
          sets.push_back(
              {nth("f", static_cast<int>(parent)), nth("f", static_cast<int>(child)), t});
      }
      const bool removes = random() % 16 == 0 && w.id("f1") != 0;
      if (removes) {
        w.tree.remove_frame("f1", true);
        continue;
      }
      // A copy without a limit of what `w` holds, to which these rows are added.
      World trial;
      for (FrameId id = 1; id <= w.tree.size(); ++id)
        if (const FrameId parent = w.tree.parent(id, kNoStamp); parent != 0)
          CHECK(trial.set(std::string(w.tree.name(parent)), std::string(w.tree.name(id)), 0));
      const auto parent_of = [&](const std::string& child) {
        return trial.tree.name(trial.tree.parent(trial.id(child), kNoStamp));
      };
      std::map<std::string, std::string> before;
      for (const Set& set : sets) before[set.child] = parent_of(set.child);
      const Code refused = w.refusal(sets), without_limit = trial.refusal(sets);
      // A cycle of more links than the limit is refused as too deep.
      if (refused == Code::invalid_argument) CHECK_EQ(without_limit, Code::invalid_argument);
      if (without_limit != Code::ok) {
        CHECK(refused != Code::ok);
        continue;
      }
      std::uint32_t deepest = 0;
      for (const auto& [child, parent] : before)
        if (parent_of(child) != parent)
          deepest = std::max(deepest, depth_of(trial, trial.id(child)));
      CHECK_EQ(refused == Code::ok, deepest <= limit);
    }
  }
}

TEST(removal_finds_the_subtree_after_many_changes) {
  World w;
  for (int i = 0; i < 50; ++i) w.set("a", nth("x", i), 1);
  for (int i = 0; i < 50; i += 2) w.set("b", nth("x", i), 2);
  for (int i = 0; i < 50; i += 4) w.set("x1", nth("x", i), 3);
  w.tree.remove_frame("a", true);
  for (int i = 0; i < 50; ++i) CHECK_EQ(w.id(nth("x", i)) != 0, i % 4 == 2);
  w.tree.clear(false);
  w.tree.remove_frame("b", false);  // nothing is below it any more
}

// By commits of one link without a limit, and up to one also by a commit of all.
TEST(a_long_chain_is_built_from_either_end) {
  struct Case {
    std::uint32_t limit, links;
    bool at_once;
  };
  for (const auto [limit, links, at_once] : {Case{0, 50'000, false}, Case{0, 1'000, true},
                                             Case{1'000, 1'000, false}, Case{1'000, 1'000, true}})
    for (const bool from_leaf : {false, true}) {
      std::vector<std::string> names;
      for (std::uint32_t i = 0; i <= links; ++i) names.push_back(nth("f", static_cast<int>(i)));
      std::vector<std::uint8_t> stored(links);
      Tree tree(Options{.max_frames = links + 4, .max_depth = limit});
      const auto set = [&](std::span<const Row> rows, std::span<const std::string_view> views) {
        tree.commit({views, rows}, stored);
      };
      const std::vector<std::string_view> views(names.begin(), names.end());
      std::vector<Row> rows;
      for (std::uint32_t i = 0; i < links; ++i) rows.push_back({i, i + 1, 1, {}});
      if (from_leaf) std::reverse(rows.begin(), rows.end());
      if (at_once) set(rows, views);
      for (const Row& row : rows) {
        const std::string_view both[] = {views[row.parent], views[row.child]};
        const Row alone{0, 1, 2, {}};
        set({&alone, 1}, both);
      }
      Answer answer;
      tree.lookup({Op::latest_xact, tree.find(names.front()), tree.find(names.back())}, answer);
      CHECK_EQ(answer.failure.code, Code::ok);
      const std::string_view below[] = {views.back(), "below"}, loop[] = {views.back(), views[0]};
      const Row alone{0, 1, 2, {}};
      CHECK_EQ(rejection([&] { set({&alone, 1}, below); }).has_value(), limit != 0);
      const auto closed = rejection([&] { set({&alone, 1}, loop); });
      CHECK(closed && closed->code == Code::invalid_argument);
    }
}

// Paths of past times may form a loop, in which a lookup must end without a limit, too.
TEST(a_loop_of_past_links_ends_without_a_limit) {
  World w(Options{.max_frames = 64, .max_depth = 0});
  w.set("x", "other", 1);
  w.set("root", "a", 3);
  w.set("a", "b", 1);
  w.set("a", "b", 3);
  CHECK_EQ(w.refusal({{"b", "a", 3}}), Code::invalid_argument);
  w.accept({{"b", "a", 2}});
  CHECK_EQ(w.code(Op::at, "x", "a", 2), Code::lookup);
  CHECK_EQ(w.code(Op::at, "x", "a", 3), Code::connectivity);
}

TEST(a_chain_that_is_gone_does_not_count) {
  Tree tree(Options{.max_frames = 40'000});
  std::vector<std::uint8_t> stored(20'000);
  const auto commit = [&](const std::vector<Set>& sets) {
    std::vector<std::string_view> names;
    std::vector<Row> rows;
    for (const Set& set : sets) {
      const auto at = static_cast<std::uint32_t>(names.size());
      names.push_back(set.parent);
      names.push_back(set.child);
      rows.push_back({at, at + 1, set.stamp, {}});
    }
    tree.commit({names, rows}, stored);
  };
  std::vector<Set> leaves;
  for (int i = 0; i < 20'000; ++i) leaves.push_back({"hub", nth("leaf", i), 1});
  commit(leaves);
  commit({{"root", "hub", 1}});
  commit(chain("hub", "deep", 900));
  tree.remove_frame("deep1", true);
  commit(chain("root", "other", 200));
  commit({{"other200", "hub", 2}});
  CHECK_EQ(tree.parent(tree.find("hub"), kNoStamp), tree.find("other200"));
}

TEST(a_rejected_commit_leaves_the_links_as_they_were) {
  Options options{.max_frames = 64, .max_memory_bytes = 1u << 20};
  options.one_authority_per_frame = true;
  World w(options);
  w.set("root", "a", 1);
  w.set("a", "b", 1);
  w.set("b", "c", 1);
  const std::vector<Set> legal = {{"c", "a", 5}, {"root", "b", 5}, {"new", "root", 5}};
  std::vector<Set> closing = legal;
  closing.push_back({"a", "new", 5});  // a is the lowest frame whose link is on the cycle
  const auto cycle = w.commit(closing);
  CHECK(cycle && cycle->code == Code::invalid_argument && cycle->frame == "a");
  std::vector<Set> too_large = legal;
  for (int i = 0; i < 20'000; ++i) too_large.push_back({"c", "full", i});
  CHECK_EQ(w.refusal(too_large), Code::limit);
  CHECK_EQ(w.refusal(legal, {.reads = {{"a", 12'345}}}), Code::conflict);
  CHECK_EQ(w.refusal({{"c", "a", 2}}), Code::invalid_argument);
  CHECK_EQ(w.refusal({{"c", "root", 2}}), Code::invalid_argument);
  w.tree.remove_frame("b", true);
  CHECK(w.id("a") != 0 && w.id("b") == 0 && w.id("c") == 0 && w.id("new") == 0);
  w.tree.remove_frame("a", false);
}

TEST(cleared_links_are_gone_and_static_ones_stay) {
  for (const int statics : {2, 8}) {
    World w;
    for (int i = 1; i <= 10; ++i) w.set(nth("f", i - 1), nth("f", i), 1, {}, i <= statics);
    w.tree.clear(true);
    for (int i = 1; i <= statics; ++i)
      CHECK_EQ(w.refusal({{nth("f", i), "f0", 2}}), Code::invalid_argument);
    for (int i = statics + 1; i <= 10; ++i) {
      w.accept({{nth("f", i), "f0", 2}});
      w.tree.clear(true);
    }
    w.tree.clear(false);
    for (int i = 0; i <= 10; ++i) w.tree.remove_frame(nth("f", i), false);
  }
}
