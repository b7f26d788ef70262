// The memory of samples: its limit, its reuse, and the cost of storing many samples at once.
#include <ctime>
#include <functional>

#include "fixture.hpp"

using namespace ztf;

namespace {

constexpr std::uint64_t kMiB = 1 << 20;

// Rows of one link, with stamps from `begin` on, `step` apart.
std::vector<Set> samples(const std::string& child, Stamp begin, int count, Stamp step = 1) {
  std::vector<Set> sets;
  for (int i = 0; i < count; ++i) sets.push_back({"root", child, begin + i * step, at_x(i)});
  return sets;
}

// Of the processor, so that other programs do not count.
double seconds(const std::function<void()>& body) {
  const std::clock_t begun = std::clock();
  body();
  return static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC;
}

}  // namespace

TEST_EACH_MODE(a_commit_that_needs_too_much_memory_writes_nothing) {
  World w(Options{.concurrency = c, .max_memory_bytes = kMiB});
  w.accept(samples("a", 1, 1000));
  std::vector<Set> sets = samples("b", 1, 100);
  for (const Set& set : samples("c", 1, 20'000)) sets.push_back(set);
  const std::uint64_t bytes = w.tree.memory_bytes();
  const auto rejected = w.commit(sets);
  CHECK(rejected);
  if (!rejected) return;
  CHECK_EQ(rejected->code, Code::limit);
  CHECK_EQ(rejected->field, "max_memory");
  CHECK_EQ(rejected->frame, "c");
  CHECK_EQ(rejected->limit, static_cast<std::int64_t>(kMiB));
  CHECK_EQ(w.id("b"), 0u);
  CHECK(w.tree.memory_bytes() <= kMiB);
  CHECK(w.tree.memory_bytes() < bytes + 20'000);
  // What was reserved for b is used again.
  const std::uint64_t before = w.tree.memory_bytes();
  w.accept(samples("d", 1, 100));
  CHECK_EQ(w.tree.memory_bytes(), before);
  CHECK_EQ(w.code(Op::at, "root", "a", 500), Code::ok);
}

TEST(memory_reaches_a_plateau) {
  World w(Options{.cache_ns = 1'000'000});
  std::uint64_t plateau = 0;
  for (int round = 0; round < 200; ++round) {
    const std::string name = nth("frame", round % 50);
    const Stamp begin = 1 + round * 10'000;
    for (int i = 0; i < 20; ++i)  // in order, then out of order
      w.accept(samples(name, begin + (i * 7 % 20) * 100, 100));
    if (round % 3 == 0) w.tree.clear(true);
    w.tree.remove_frame(name, false);
    if (round == 20) plateau = w.tree.memory_bytes();
  }
  CHECK_EQ(w.tree.memory_bytes(), plateau);
}

TEST_EACH_MODE(samples_out_of_order_are_merged) {
  World w(c);
  std::vector<std::uint8_t> stored;
  w.accept(samples("a", 0, 1000, 2));
  std::vector<Set> late = samples("a", 1, 1000, 2);
  late.push_back({"root", "a", 500, at_x(-1)});
  late.push_back({"other", "a", 501, at_x(-2)});
  late.push_back({"root", "a", 501, at_x(-3)});
  CHECK(!w.commit(late, {}, &stored));
  for (const std::uint8_t result : stored) CHECK_EQ(result, RowResult::stored);
  const FrameInfo info = w.info("a");
  CHECK_EQ(info.samples, 2000u);
  CHECK_EQ(info.oldest, 0);
  CHECK_EQ(info.newest, 1999);
  CHECK_EQ(w.events("a").rewritten.load(), 3u);
  CHECK_EQ(w.at("root", "a", 500).pose.x, -1);
  CHECK_EQ(w.at("root", "a", 501).pose.x, -3);
  CHECK_EQ(w.at("root", "a", 602).pose.x, 301);
}

// 33,000 rows into a ring of 33,000 samples took 4 to 6 s: each one moved all later samples.
TEST(a_commit_out_of_order_is_not_quadratic) {
  const auto merge = [](int n) {
    World w;
    w.accept(samples("a", 0, n, 2));
    std::vector<Set> late = samples("a", 1, n, 2);
    std::reverse(late.begin(), late.end());
    return seconds([&] { w.accept(late); });
  };
  double ratio = 1e9;  // of four times as many: about 4, against 16
  for (int attempt = 0; attempt < 5 && ratio > 10; ++attempt)
    ratio = std::min(ratio, merge(32'000) / merge(8'000));
  CHECK(ratio <= 10);
}
