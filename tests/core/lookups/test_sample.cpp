// A batch of many times of one pair of frames gives the same answers as single lookups.
#include <algorithm>
#include <random>

#include "lookups/histories.hpp"

using namespace ztf;

namespace {

void check_same_rows(const World& w, const std::vector<Query>& queries) {
  std::vector<Answer> answers(queries.size());
  w.tree.lookup_batch(queries, answers);
  for (std::size_t i = 0; i < queries.size(); ++i) {
    const Answer& a = answers[i];
    Answer one;
    w.tree.lookup(queries[i], one);
    const Failure &f = a.failure, &g = one.failure;
    CHECK_EQ(f.code, g.code);
    if (g.code != Code::ok) {
      CHECK(f.target == g.target && f.source == g.source && f.frame == g.frame &&
            f.parent == g.parent && f.target_root == g.target_root &&
            f.source_root == g.source_root && f.stamp == g.stamp && f.oldest == g.oldest &&
            f.newest == g.newest && f.max_gap == g.max_gap);
      continue;
    }
    CHECK_EQ(a.stamp, one.stamp);
    CHECK_EQ(a.gap, one.gap);
    const double *x = &a.pose.x, *y = &one.pose.x;
    // The order of products differs.
    for (int k = 0; k < 7; ++k) CHECK_NEAR(x[k], y[k], 1e-13 * (1 + std::abs(y[k])));
  }
}

// With any time between two samples, and with limits of it.
void check_same(const World& w, std::vector<Query> queries) {
  for (const Stamp limit : {kNoGapLimit, kNoGaps, Stamp{0}, Stamp{8}, Stamp{40}}) {
    for (Query& query : queries) query.max_gap = limit;
    check_same_rows(w, queries);
  }
}

std::vector<Query> at_times(const World& w, const std::string& target, const std::string& source,
                            const std::vector<Stamp>& stamps) {
  std::vector<Query> queries;
  for (const Stamp stamp : stamps) queries.push_back(w.query(Op::at, target, source, stamp));
  return queries;
}

// root -> a -> b -> c -> d with a static link, root -> l; samples from 100 to 1100 or so, of `a` at
// regular times. All kinds of angles between samples, quaternions of either sign.
// `moved`: `d` hung below `l` until 600. Then blocks are no longer answered in one go.
void fill(World& w, bool moved) {
  std::mt19937 random(3);
  const auto samples = [&](const char* parent, const char* child, Stamp from, Stamp to,
                           unsigned least, unsigned most) {
    add_samples(w, random, parent, child, from, to, least, most);
  };
  samples("root", "a", 100, 1100, 10, 10);
  samples("a", "b", 90, 1090, 1, 3);
  w.set("b", "c", 0, some_pose(4), true);
  if (moved) samples("l", "d", 80, 600, 1, 9);
  samples("c", "d", moved ? 601 : 110, 1110, 1, 30);
  samples("root", "l", 100, 1000, 1, 200);
  w.set("root", "once", 500, some_pose(2));
  w.set("island", "shore", 500, some_pose(2));
}

template <class Test>
void for_each_fill(Test&& test) {
  for_each_concurrency([&](Concurrency c) {
    for (const bool moved : {false, true}) {
      World w(c);
      fill(w, moved);
      test(w);
    }
  });
}

}  // namespace

TEST(a_batch_answers_like_single_lookups) {
  for_each_fill([](World& w) {
    std::mt19937 random(5);
    const auto some = [&](std::size_t n, Stamp from, Stamp to) {
      std::vector<Stamp> stamps(n);
      for (Stamp& t : stamps)
        t = from + static_cast<Stamp>(random() % static_cast<unsigned>(to - from));
      return stamps;
    };
    const std::pair<const char*, const char*> pairs[] = {
        {"root", "d"},    {"d", "root"},     {"l", "d"},      {"d", "l"}, {"a", "c"},
        {"b", "c"},       {"c", "b"},        {"root", "a"},   {"l", "c"}, {"d", "d"},
        {"root", "once"}, {"root", "shore"}, {"d", "nowhere"}};
    for (const auto& [target, source] : pairs) {
      for (const std::size_t n : {1, 7, 8, 9, 63, 64, 65, 300}) {
        std::vector<Stamp> stamps = some(n, 0, 1200);
        check_same(w, at_times(w, target, source, stamps));
        std::sort(stamps.begin(), stamps.end());
        check_same(w, at_times(w, target, source, stamps));
        std::reverse(stamps.begin(), stamps.end());
        check_same(w, at_times(w, target, source, stamps));
        std::sort(stamps.begin(), stamps.end());
        for (Stamp& t : stamps)
          t = 600 + t / 20;  // many between two samples, across the new parent
        check_same(w, at_times(w, target, source, stamps));
      }
      std::vector<Stamp> every(1300);
      for (std::size_t i = 0; i < every.size(); ++i) every[i] = static_cast<Stamp>(i);
      check_same(w, at_times(w, target, source, every));  // exactly at samples, too
      check_same(w, at_times(w, target, source, some(100, 1200, 1300)));
      check_same(w, at_times(w, target, source, std::vector<Stamp>(100, 500)));
      check_same(w, at_times(w, target, source, std::vector<Stamp>(20, kNoStamp + 1)));
    }
    CHECK_EQ(w.at("root", "d", 700).failure.code, Code::ok);
    CHECK_EQ(w.at("root", "d", 300).failure.code, Code::ok);
  });
}

TEST(rows_of_all_kinds_beside_each_other) {
  for_each_fill([](World& w) {
    std::mt19937 random(7);
    const char* names[] = {"root", "d", "l", "nowhere"};
    std::vector<Query> queries;
    for (int run = 0; run < 60; ++run) {
      const Query query = w.query(random() % 4 ? Op::at : Op::latest_common, names[random() % 4],
                                  names[random() % 4], 0);
      for (unsigned i = 0, n = random() % 80; i < n; ++i) {
        queries.push_back(query);
        queries.back().stamp =
            query.op == Op::latest_common ? kNoStamp : 200 + static_cast<Stamp>(random() % 800);
      }
    }
    check_same(w, queries);
  });
}

TEST(after_a_switch_or_a_clear_nothing_is_left) {
  for_each_fill([](World& w) {
    std::vector<Stamp> stamps(70);
    for (std::size_t i = 0; i < stamps.size(); ++i) stamps[i] = 400 + 7 * static_cast<Stamp>(i);
    w.set("a", "b", 0, some_pose(1), true);  // was dynamic, has a ring
    check_same(w, at_times(w, "root", "d", stamps));
    w.set("a", "b", 550, some_pose(1));  // and is again, with one sample
    check_same(w, at_times(w, "root", "d", stamps));
    w.tree.clear(true);
    check_same(w, at_times(w, "root", "d", stamps));
    check_same(w, at_times(w, "b", "c", stamps));
  });
}

TEST(a_chain_longer_than_the_direct_walk) {
  World w;
  for (int i = 0; i < 70; ++i)
    for (const Stamp t : {0, 10, 20})
      w.set(nth("f", i), nth("f", i + 1), t, some_pose(i + static_cast<int>(t)));
  std::vector<Stamp> stamps(100);
  for (std::size_t i = 0; i < stamps.size(); ++i) stamps[i] = static_cast<Stamp>(i / 5);
  check_same(w, at_times(w, "f0", "f70", stamps));
  check_same(w, at_times(w, "f70", "f0", stamps));
}

// Each of the two was once the other's child, and for a while both were.
TEST_EACH_MODE(a_loop_of_past_links_has_a_second_chain) {
  for (const bool between : {false, true}) {
    World w(c);
    const char* const via = between ? "via" : "arm";
    if (between)
      for (const Stamp t : {260, 380}) w.set("arm", "via", t, some_pose(9));
    w.set("map", "base", 260, some_pose(1));
    w.set("base", "arm", 300, some_pose(2));
    w.set("base", "arm", 370, some_pose(3));
    w.set("map", "arm", 375, some_pose(5));
    w.set(via, "base", 340, some_pose(4));
    w.set(via, "base", 380, some_pose(6));
    w.set("map", "arm", 380, some_pose(5));
    std::vector<Stamp> stamps(100);
    for (std::size_t i = 0; i < stamps.size(); ++i) stamps[i] = 300 + static_cast<Stamp>(i);
    for (const auto& [target, source] :
         {std::pair("arm", "base"), {"base", "arm"}, {"map", "base"}})
      check_same(w, at_times(w, target, source, stamps));
  }
}
