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
