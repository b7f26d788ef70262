// A motion that is copied out of a tree gives the poses of single lookups.
#include "reads/motion.hpp"

#include "geometry/deskew.hpp"
#include "lookups/histories.hpp"

using namespace ztf;

namespace {

constexpr Stamp kAt = 640;

// Where a point at a time is in the source frame as it is at kAt.
Vec3 by_lookup(const World& w, const std::string& fixed, const std::string& source, Stamp time,
               const Vec3& p) {
  const Answer then = w.at(fixed, source, time), now = w.at(fixed, source, kAt);
  CHECK(then.failure.code == Code::ok && now.failure.code == Code::ok);
  const Pose move = inverse(now.pose) * then.pose;
  return add_rotation(move, p, {p.x + move.x, p.y + move.y, p.z + move.z});
}

Vec3 image(const PointMap& map, const Vec3& p) {
  const Double4 at = map.c[3] + p.x * map.c[0] + p.y * map.c[1] + p.z * map.c[2];
  return {at[0], at[1], at[2]};
}

// Copies the motion and compares it with lookups at every time from `first` to `last`.
void check_motion(const World& w, const std::string& fixed, const std::string& source, Stamp first,
                  Stamp last, bool ascending = true) {
  Motion motion;
  Answer answer;
  const auto result =
      w.tree.lookup_motion({w.id(fixed), w.id(source), kAt, first, last}, motion, answer);
  CHECK_EQ(answer.failure.code, Code::ok);
  CHECK(result == MotionResult::copied);
  motion.fix_at(kAt);
  std::vector<Stamp> times;
  for (Stamp t = first; t <= last; ++t) times.push_back(t);
  if (!ascending) std::shuffle(times.begin(), times.end(), std::mt19937(5));
  std::vector<PointMap> maps(times.size() + 3);
  motion.compute(times, maps.data());
  const Vec3 p{3, -20, 7};
  for (std::size_t i = 0; i < times.size(); ++i) {
    const Vec3 expected = by_lookup(w, fixed, source, times[i], p), got = image(maps[i], p);
    CHECK_NEAR(got.x, expected.x, 1e-10);
    CHECK_NEAR(got.y, expected.y, 1e-10);
    CHECK_NEAR(got.z, expected.z, 1e-10);
  }
}

// root -> a -> b -> c -> d with a static link in the middle, root -> l -> m: samples from 100 to
// 1100 at any times, with small and large angles between them, and quaternions of either sign.
void fill(World& w) {
  std::mt19937 random(3);
  const auto samples = [&](const char* parent, const char* child, unsigned least, unsigned most) {
    add_samples(w, random, parent, child, 100, 1100, least, most);
    w.set(parent, child, 1101, some_pose(3));
  };
  samples("root", "a", 10, 10);
  samples("a", "b", 1, 3);
  w.set("b", "c", 0, some_pose(5), true);
  samples("c", "d", 7, 70);
  samples("root", "l", 3, 30);
  w.set("l", "m", 0, some_pose(2), true);
}

}  // namespace

TEST_EACH_MODE(poses_are_those_of_lookups) {
  World w(c);
  fill(w);
  for (const auto& [fixed, source] : {std::pair("root", "d"),
                                      {"d", "root"},
                                      {"a", "d"},
                                      {"m", "d"},
                                      {"d", "m"},
                                      {"b", "c"},
                                      {"d", "d"}}) {
    check_motion(w, fixed, source, 300, 720);
    check_motion(w, fixed, source, 100, 1101);  // the whole history
    check_motion(w, fixed, source, 640, 640);   // one time
    check_motion(w, fixed, source, 300, 400, false);
  }
}

TEST(a_failure_names_the_time) {
  World w;
  fill(w);
  const auto failure = [&](const char* fixed, const char* source, Stamp at, Stamp first,
                           Stamp last) {
    Motion motion;
    Answer answer;
    (void)w.tree.lookup_motion({w.id(fixed), w.id(source), at, first, last}, motion, answer);
    return answer.failure;
  };
  CHECK_EQ(failure("root", "none", 500, 400, 600).code, Code::lookup);
  CHECK_EQ(failure("root", "d", 500, 99, 600).code, Code::backward);
  CHECK_EQ(failure("root", "d", 500, 99, 600).stamp, 99);
  CHECK_EQ(failure("root", "d", 500, 400, 1200).code, Code::forward);
  CHECK_EQ(failure("root", "d", 500, 400, 1200).stamp, 1200);
  CHECK_EQ(failure("root", "d", 50, 400, 1200).stamp, 50);
  w.set("other", "x", 500);
  CHECK_EQ(failure("root", "x", 500, 500, 500).code, Code::connectivity);
  CHECK_EQ(failure("other", "x", 500, 500, 500).code, Code::ok);  // its only sample
  CHECK_EQ(failure("other", "x", 500, 500, 501).code, Code::no_data);
}

// A chain is copied unless one of its own frames was reparented.
TEST(a_chain_that_may_differ_in_time_is_not_copied) {
  World w;
  fill(w);
  w.set("root", "hand", 100);
  w.set("root", "cup", 100);
  w.set("root", "cup", 500);
  w.set("hand", "cup", 600);
  w.set("hand", "cup", 1000);
  const auto result = [&](const char* fixed, const char* source) {
    Motion motion;
    Answer answer;
    const auto found =
        w.tree.lookup_motion({w.id(fixed), w.id(source), 640, 600, 700}, motion, answer);
    CHECK_EQ(answer.failure.code, Code::ok);
    return found;
  };
  CHECK(result("root", "d") == MotionResult::copied);
  check_motion(w, "root", "d", 300, 720);
  CHECK(result("m", "d") == MotionResult::copied);
  CHECK(result("hand", "cup") == MotionResult::varies);
}

// A sweep with more distinct times than the table holds, in portions, from one array to another.
TEST(a_sweep_is_moved_point_by_point) {
  World w;
  fill(w);
  Motion motion;
  Answer answer;
  (void)w.tree.lookup_motion({w.id("root"), w.id("d"), kAt, 100, 1101}, motion, answer);
  motion.fix_at(kAt);
  constexpr std::size_t kRows = 3, kColumns = 2500;
  std::mt19937 random(1);
  std::vector<float> points(kRows * kColumns * 3), out(points.size());
  std::vector<Stamp> stamps(kRows * kColumns);
  for (float& number : points) number = static_cast<float>(random() % 1000) * 0.01f;
  for (Stamp& stamp : stamps) stamp = 100 + static_cast<Stamp>(random() % 1002);
  const auto array = [&](std::vector<float>& numbers) {
    return PointArray{
        reinterpret_cast<std::byte*>(numbers.data()), kRows, kColumns, 12 * kColumns, 12, 4, false};
  };
  deskew(motion, {reinterpret_cast<const std::byte*>(stamps.data()), 8 * kColumns, 8},
         array(points), array(out));
  for (std::size_t i = 0; i < stamps.size(); i += 7) {
    const Vec3 p{points[3 * i], points[3 * i + 1], points[3 * i + 2]};
    const Vec3 expected = by_lookup(w, "root", "d", stamps[i], p);
    CHECK_NEAR(out[3 * i], expected.x, 1e-5);
    CHECK_NEAR(out[3 * i + 1], expected.y, 1e-5);
    CHECK_NEAR(out[3 * i + 2], expected.z, 1e-5);
  }
}

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
