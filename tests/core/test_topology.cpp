// The limit of depths, and the index of the newest links that it rests on.
#include <chrono>
#include <functional>
#include <random>

#include "fixture.hpp"

using namespace ztf;

namespace {

std::string nth(const std::string& prefix, int n) { return prefix + std::to_string(n); }

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

double seconds(const std::function<void()>& body) {
  const auto begun = std::chrono::steady_clock::now();
  body();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}

}  // namespace

TEST(a_frame_that_would_be_too_deep_is_named) {
  World w(Options{.max_depth = 10});
  CHECK_EQ(w.refusal(chain("root", "a", 10)), Code::ok);
  CHECK_EQ(w.refusal(chain("top", "b", 4)), Code::ok);
  const auto rejected = w.commit({{"b4", "root", 2}});
  CHECK(rejected);
  if (!rejected) return;
  CHECK_EQ(rejected->code, Code::limit);
  CHECK_EQ(rejected->field, "max_depth");
  CHECK_EQ(rejected->frame, "root");
  CHECK_EQ(rejected->limit, 10);
  CHECK_EQ(rejected->value, 15);
  CHECK_EQ(w.refusal(chain("x", "new", 11)), Code::limit);
  CHECK_EQ(w.id("new1"), 0u);
  // What counts is the tree after the commit, whatever comes first.
  CHECK_EQ(w.refusal({{"a3", "top", 3}}), Code::ok);  // 3 + 1 + 4
  CHECK_EQ(w.refusal({{"b1", "root", 4}, {"other", "top", 4}, {"root2", "a1", 4}}), Code::ok);
}

TEST(a_chain_at_the_limit_can_be_reversed) {
  World w(Options{.max_depth = 10});
  CHECK_EQ(w.refusal(chain("a0", "a", 10)), Code::ok);
  std::vector<Set> reversed;
  for (int i = 1; i <= 10; ++i) reversed.push_back({nth("a", i), nth("a", i - 1), 2});
  CHECK_EQ(w.refusal({{"top", "a10", 3}}), Code::ok);  // a10 is alone at first
  reversed.push_back({"top", "a10", 3});
  CHECK_EQ(w.refusal(reversed), Code::limit);  // a0 would be 11 below top
  reversed.erase(reversed.begin());
  CHECK_EQ(w.refusal(reversed), Code::ok);
}

// The index's upper bounds grow with each of these, and are then found again.
TEST(frames_that_swap_places_for_ever_are_never_refused) {
  World w(Options{.max_depth = 3});
  w.set("root", "a", 1);
  w.set("root", "b", 1);
  for (Stamp t = 2; t < 200; t += 2) {
    CHECK_EQ(w.refusal({{"a", "b", t}}), Code::ok);
    CHECK_EQ(w.refusal({{"root", "b", t + 1}, {"b", "a", t + 1}}), Code::ok);
    CHECK_EQ(w.refusal({{"root", "a", t + 1}}), Code::ok);
  }
}

TEST(random_changes_are_refused_exactly_if_a_frame_would_be_too_deep) {
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
      const Code refused = w.refusal(sets);
      // The copy is made again from what `w` holds, with these rows added.
      World trial;
      std::vector<Set> held;
      for (FrameId id = 1; id <= w.tree.size(); ++id)
        if (const FrameId parent = w.tree.parent(id, kNoStamp); parent != 0)
          if (refused != Code::ok)
            held.push_back({std::string(w.tree.name(parent)), std::string(w.tree.name(id)), 0});
      if (refused != Code::ok) {
        for (const Set& set : held) CHECK(trial.set(set.parent, set.child, 0));
        const Code without_limit = trial.refusal(sets);
        CHECK_EQ(refused == Code::invalid_argument, without_limit == Code::invalid_argument);
        if (without_limit != Code::ok) continue;
      }
      World& after = refused == Code::ok ? w : trial;
      std::uint32_t deepest = 0;
      for (FrameId id = 1; id <= after.tree.size(); ++id)
        deepest = std::max(deepest, depth_of(after, id));
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

// 20,000 new frames in one commit took 8 s when each link was followed to the root by itself.
TEST(the_check_of_a_commit_is_linear) {
  const auto build = [](int n) {
    Tree tree(Options{.max_frames = 200'000, .max_depth = 1u << 20});
    std::vector<std::string> names{"root"};
    std::vector<std::string_view> views;
    std::vector<Row> rows;
    for (int i = 1; i <= n; ++i) names.push_back(nth("f", i));
    for (const std::string& name : names) views.push_back(name);
    // The lowest first, so that each walk would go all the way.
    for (int i = n; i > 0; --i)
      rows.push_back({static_cast<std::uint32_t>(i - 1), static_cast<std::uint32_t>(i), 1, {}});
    std::vector<std::uint8_t> stored(rows.size());
    const double built = seconds([&] { tree.commit({views, rows}, stored); });
    const std::string_view more[] = {names.back(), "leaf"};
    const Row row{0, 1, 1, {}};
    tree.commit({more, {&row, 1}}, stored);
    return built;
  };
  double ratio = 1e9;  // of four times as much: about 4, against 16
  for (int attempt = 0; attempt < 5 && ratio > 10; ++attempt)
    ratio = std::min(ratio, build(80'000) / build(20'000));
  CHECK(ratio <= 10);
}
