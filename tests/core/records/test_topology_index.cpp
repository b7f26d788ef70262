// The index of the newest links, compared with one that follows links.
#include "records/topology_index.hpp"

#include <algorithm>
#include <random>
#include <vector>

#include "check.hpp"

using namespace ztf;

namespace {

struct Naive {
  std::vector<FrameId> parents;  // by frame; 0: a root

  [[nodiscard]] std::uint32_t depth(FrameId id) const {
    std::uint32_t links = 0;
    for (; parents[id] != 0; id = parents[id]) ++links;
    return links;
  }
  [[nodiscard]] FrameId root(FrameId id) const {
    while (parents[id] != 0) id = parents[id];
    return id;
  }
  [[nodiscard]] bool is_below(FrameId id, FrameId top) const {
    while (id != top && id != 0) id = parents[id];
    return id == top;
  }
  [[nodiscard]] std::vector<FrameId> subtree(FrameId top) const {
    std::vector<FrameId> frames;
    for (FrameId id = 1; id < parents.size(); ++id)
      if (is_below(id, top)) frames.push_back(id);
    return frames;
  }
  [[nodiscard]] std::uint32_t height(FrameId top) const {
    std::uint32_t deepest = 0;
    for (const FrameId id : subtree(top)) deepest = std::max(deepest, depth(id));
    return deepest - depth(top);
  }
};

void check_equal(const TopologyIndex& index, const Naive& naive) {
  for (FrameId id = 1; id < naive.parents.size(); ++id) {
    CHECK_EQ(index.depth(id), naive.depth(id));
    CHECK_EQ(index.height(id), naive.height(id));
    CHECK_EQ(index.connected(id, 1), naive.root(id) == naive.root(1));
    std::vector<FrameId> visited;
    index.visit_subtree(id, [&](FrameId frame) {
      const FrameId parent = naive.parents[frame];
      CHECK(frame == id || std::find(visited.begin(), visited.end(), parent) != visited.end());
      visited.push_back(frame);
    });
    const FrameId child = index.first_child(id);
    CHECK(child == 0 ? visited.size() == 1 : naive.parents[child] == id);
    std::sort(visited.begin(), visited.end());
    CHECK(visited == naive.subtree(id));
  }
}

// How many steps a forest of that many frames may cost for each write: about 12 searches, each of
// less than 4 log2 n steps.
double bound_of(FrameId frames) { return 12 * 4 * std::log2(frames); }

}  // namespace

TEST(random_links_and_cuts_give_what_following_links_gives) {
  std::mt19937 random(11);
  for (int round = 0; round < 20; ++round) {
    const FrameId frames = 2 + random() % 40;
    TopologyIndex index(frames + 1);
    Naive naive{std::vector<FrameId>(frames + 1)};
    for (int step = 0; step < 150; ++step) {
      const FrameId a = 1 + random() % frames, b = 1 + random() % frames;
      if (random() % 20 == 0) {
        const std::vector<FrameId> gone = naive.subtree(a);
        index.cut(a);
        for (const FrameId id : gone) index.forget(id), naive.parents[id] = 0;
      } else if (random() % 3 == 0) {
        index.cut(a);
        naive.parents[a] = 0;
      } else if (!naive.is_below(b, a)) {
        index.cut(a);
        naive.parents[a] = b;
        CHECK(!index.connected(a, b));
        CHECK_EQ(index.link(a, b), naive.height(naive.root(b)));
      }
      check_equal(index, naive);
    }
  }
}

// A check that follows links takes n / 2 steps a link in one of these orders.
TEST(a_chain_costs_a_logarithm_a_link_in_any_order) {
  constexpr FrameId kFrames = 100'000;
  std::vector<FrameId> order;
  for (FrameId id = 2; id <= kFrames; ++id) order.push_back(id);
  for (int way = 0; way < 3; ++way) {  // from the root, from the leaf, from everywhere
    if (way == 1) std::reverse(order.begin(), order.end());
    if (way == 2) std::shuffle(order.begin(), order.end(), std::mt19937(5));
    TopologyIndex index(kFrames + 1);
    for (const FrameId id : order) (void)index.link(id, id - 1);
    CHECK_EQ(index.depth(kFrames), kFrames - 1);
    CHECK_EQ(index.height(1), kFrames - 1);
    CHECK(static_cast<double>(index.steps()) < kFrames * bound_of(kFrames));
  }
}

// No single write may be long, because it holds the topology mutex.
TEST(no_link_or_cut_of_a_deep_or_wide_tree_is_long) {
  constexpr FrameId kFrames = 100'000;
  std::mt19937 random(3);
  for (const bool is_deep : {false, true}) {
    TopologyIndex index(kFrames + 2);
    for (FrameId id = 2; id <= kFrames; ++id) (void)index.link(id, is_deep ? id - 1 : 1);
    std::uint64_t most = 0;
    for (int i = 0; i < 2'000; ++i) {
      const FrameId id = 2 + random() % (kFrames - 1);
      const std::uint64_t before = index.steps();
      index.cut(id);
      CHECK(!index.connected(id, 1));
      (void)index.link(id, is_deep ? id - 1 : 1);
      (void)index.link(kFrames + 1, id);
      CHECK_EQ(index.depth(kFrames + 1), index.depth(id) + 1);
      index.cut(kFrames + 1);
      most = std::max(most, index.steps() - before);
    }
    CHECK(static_cast<double>(most) < 4 * bound_of(kFrames));
  }
}
