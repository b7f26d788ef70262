// The cost of storing many samples at once. Limits of memory: tests/tree/test_tree_memory.py.
#include <ctime>
#include <functional>

#include "fixture.hpp"

using namespace ztf;

namespace {

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
