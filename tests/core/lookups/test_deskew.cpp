// The table of a sweep's times. That a sweep is moved as single lookups say is proved by
// tests/transforms/test_deskew.py.
#include "fixture.hpp"
#include "geometry/deskew.hpp"

using namespace ztf;

// The table of a sweep computes each time once, and is cleared when it is full.
TEST(each_time_is_computed_once) {
  struct Counted {
    std::size_t computed = 0;
    void compute(std::span<const Stamp> times, PointMap* maps) {
      computed += times.size();
      for (std::size_t i = 0; i < times.size(); ++i)
        maps[i] = PointMap::of(at_x(static_cast<double>(times[i])));
    }
  };
  const auto run = [](std::size_t distinct) {
    Counted counted;
    std::vector<double> points(3 * 20'000), out(points.size());
    std::vector<Stamp> stamps(20'000);
    for (std::size_t i = 0; i < stamps.size(); ++i) stamps[i] = static_cast<Stamp>(i % distinct);
    const auto array = [&](std::vector<double>& numbers) {
      return PointArray{reinterpret_cast<std::byte*>(numbers.data()), 1, 20'000, 0, 24, 8, true};
    };
    deskew(counted, {reinterpret_cast<const std::byte*>(stamps.data()), 0, 8}, array(points),
           array(out));
    for (std::size_t i = 0; i < stamps.size(); ++i)
      CHECK_EQ(out[3 * i], static_cast<double>(stamps[i]));
    return counted.computed;
  };
  CHECK_EQ(run(1), 1u);
  CHECK_EQ(run(1024), 1024u);
  CHECK_EQ(run(20'000), 20'000u);
}
