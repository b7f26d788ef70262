// What tf2's own tests ask of a BufferCore, in our words and of both: each shape of a tree, each
// order of arrival, each time that has no data.
#include <functional>

#include "both.hpp"

namespace {

using Names = std::vector<std::string>;

Pose about_z(double x, double y, double angle) {
  return {x, y, 0, 0, 0, std::sin(angle / 2), std::cos(angle / 2)};
}

// Asks both for each pair of frames at each time, also at two times by each fixed frame.
void check_all(Both& both, const Names& frames, const std::vector<std::uint64_t>& times) {
  for (const std::string& target : frames)
    for (const std::string& source : frames)
      for (const std::uint64_t time : times) {
        std::string their_text, our_text;
        CHECK_EQ(both.ours.canTransform(target, source, at(time), &our_text),
                 both.theirs.canTransform(target, source, at(time), &their_text));
        CHECK_EQ(without_link(our_text), without_link(their_text));
        check_same(
            outcome_of([&] { return both.theirs.lookupTransform(target, source, at(time)); }),
            outcome_of([&] { return both.ours.lookupTransform(target, source, at(time)); }));
        const std::string& fixed = frames[(&target - &frames[0] + time) % frames.size()];
        const ros::Time later = at(time == 0 ? 0 : time + kSecond / 3);
        CHECK_EQ(both.ours.canTransform(target, later, source, at(time), fixed),
                 both.theirs.canTransform(target, later, source, at(time), fixed));
      }
}

// The pose that both have.
Pose look_up(Both& both, const std::string& target, const std::string& source, std::uint64_t time) {
  const auto theirs =
      outcome_of([&] { return both.theirs.lookupTransform(target, source, at(time)); });
  const auto ours = outcome_of([&] { return both.ours.lookupTransform(target, source, at(time)); });
  check_same(theirs, ours);
  CHECK_EQ(ours.kind, "ok");
  return pose_of(ours.message);
}

std::string kind_of(Both& both, const std::string& target, const std::string& source,
                    std::uint64_t time) {
  const auto ours = outcome_of([&] { return both.ours.lookupTransform(target, source, at(time)); });
  check_same(outcome_of([&] { return both.theirs.lookupTransform(target, source, at(time)); }),
             ours);
  return ours.kind;
}

// All times around samples at 10 s, 11 s and 12 s, and the latest.
const std::vector<std::uint64_t> kTimes = {0,
                                           1,
                                           10 * kSecond - 1,
                                           10 * kSecond,
                                           10 * kSecond + kSecond / 4,
                                           11 * kSecond,
                                           12 * kSecond - 1,
                                           12 * kSecond,
                                           12 * kSecond + 1,
                                           500 * kSecond};

// Links parent > child, each with the three samples, moving by its number.
void set_moving(Both& both, const std::vector<std::pair<std::string, std::string>>& links) {
  int n = 0;
  for (const auto& [parent, child] : links) {
    ++n;
    for (int i = 0; i < 3; ++i)
      both.set(transform_of(parent, child, (10 + i) * kSecond, about_z(n + i, n - i, 0.3 * n * i)),
               nth("authority", n));
  }
}

}  // namespace

TEST(each_shape_of_a_tree) {
  struct Shape {
    std::vector<std::pair<std::string, std::string>> links;
    Names frames;
  };
  for (const Shape& shape : {
           Shape{{{"a", "b"}}, {"a", "b"}},                                    // one link
           Shape{{{"a", "b"}, {"b", "c"}, {"c", "d"}}, {"a", "b", "c", "d"}},  // a line
           Shape{{{"a", "b"}, {"b", "c"}, {"a", "f"}, {"f", "g"}},             // two branches
                 {"a", "b", "c", "f", "g"}},
           Shape{{{"a", "b"}, {"b", "c"}, {"b", "d"}},
                 {"a", "b", "c", "d"}},  // a fork below a line
           Shape{{{"a", "b"}, {"c", "d"}, {"d", "e"}}, {"a", "b", "c", "d", "e"}},  // two trees
       }) {
    Both both;
    set_moving(both, shape.links);
    Names frames = shape.frames;
    frames.insert(frames.end(), {"nobody", "", "/a"});
    check_all(both, frames, kTimes);
  }
}

TEST(a_ring_of_eight_frames_45_degrees_apart) {
  Both both;
  const double step = M_PI / 4;
  // Each frame is where the one before it looks along a chord of the circle of radius 1.
  const Pose link = about_z(std::cos(step) - 1, std::sin(step), step);
  Names frames = {"0"};
  for (int n = 1; n < 8; ++n) {
    frames.push_back(std::to_string(n));
    for (const int s : {10, 11, 12})
      both.set(transform_of(frames[n - 1], frames[n], s * kSecond, link), "");
  }
  check_all(both, frames, kTimes);
  for (int n = 1; n < 8; ++n) {
    const Pose expected = about_z(std::cos(n * step) - 1, std::sin(n * step), n * step);
    CHECK(distance(look_up(both, "0", frames[n], 11 * kSecond), expected) < 1e-9);
  }
}

TEST(a_helix_is_interpolated_in_position_and_angle) {
  Both both;
  const double pitch = 0.2, rate = 0.4;  // metres and radians a second
  for (int i = 0; i < 20; ++i) {
    Pose pose = about_z(0, 0, rate * i);
    pose.z = pitch * i;
    both.set(transform_of("a", "b", (10 + i) * kSecond, pose), "");
    both.set(transform_of("b", "c", (10 + i) * kSecond, about_z(1, 0, 0)), "");
  }
  for (int tenth = 0; tenth <= 190; ++tenth) {
    const double t = tenth / 10.0;
    Pose expected = about_z(std::cos(rate * t), std::sin(rate * t), rate * t);
    expected.z = pitch * t;
    CHECK(distance(look_up(both, "a", "c", 10 * kSecond + tenth * kSecond / 10), expected) < 1e-9);
    if (tenth < 170)  // what was at t is seen from where the frame is two seconds later, by a
      CHECK(distance(pose_of(both.ours.lookupTransform("b", at((12 + tenth / 10) * kSecond), "c",
                                                       at((10 + tenth / 10) * kSecond), "a")),
                     pose_of(both.theirs.lookupTransform("b", at((12 + tenth / 10) * kSecond), "c",
                                                         at((10 + tenth / 10) * kSecond), "a"))) <
            1e-9);
  }
}

TEST(samples_may_arrive_in_any_order) {
  std::mt19937 random(1);
  for (const int order : {0, 1, 2, 3, 4}) {
    Both both;
    std::vector<int> numbers(100);
    for (int i = 0; i < 100; ++i) numbers[i] = i;
    if (order == 1) std::reverse(numbers.begin(), numbers.end());
    if (order > 1) std::shuffle(numbers.begin(), numbers.end(), random);
    for (const int n : numbers)
      both.set(transform_of("a", "b", kSecond + n * kSecond / 10, about_z(n, -n, 0.05 * n)), "");
    for (int n = 0; n < 99; ++n) {
      CHECK(std::abs(look_up(both, "a", "b", kSecond + n * kSecond / 10).x - n) < 1e-12);
      CHECK(std::abs(look_up(both, "a", "b", kSecond + n * kSecond / 10 + kSecond / 20).x - n -
                     0.5) < 1e-9);
    }
    CHECK_EQ(look_up(both, "a", "b", 0).x, 99);  // the newest
  }
}

TEST(turns_are_interpolated_by_the_shorter_way) {
  std::mt19937 random(2);
  for (int i = 0; i < 200; ++i) {
    Both both;
    const Pose from = random_pose(random);
    Pose to = random_pose(random);
    if (i % 3 == 0)  // the same turn by the other quaternion
      to = {to.x, to.y, to.z, -from.qx, -from.qy, -from.qz, -from.qw};
    both.set(transform_of("a", "b", 10 * kSecond, from), "");
    both.set(transform_of("a", "b", 11 * kSecond, to), "");
    for (int n = 0; n <= 10; ++n) look_up(both, "a", "b", 10 * kSecond + n * kSecond / 10);
  }
}

TEST(nothing_is_interpolated_between_two_parents) {
  Both both;
  both.set(transform_of("a", "b", 10 * kSecond, about_z(1, 0, 0)), "");
  both.set(transform_of("c", "b", 11 * kSecond, about_z(2, 0, 0)), "");
  both.set(transform_of("a", "c", 10 * kSecond, about_z(5, 0, 0)), "", true);
  CHECK_EQ(look_up(both, "a", "b", 10 * kSecond).x, 1);
  CHECK_EQ(look_up(both, "a", "b", 10 * kSecond + kSecond / 2).x, 1);  // the older one holds
  CHECK_EQ(look_up(both, "a", "b", 11 * kSecond).x, 7);
  check_all(both, {"a", "b", "c"}, kTimes);
}

TEST(one_sample_is_no_base_for_extrapolation) {
  Both both;
  both.set(transform_of("a", "b", 10 * kSecond, kIdentity), "");
  CHECK_EQ(kind_of(both, "a", "b", 10 * kSecond), "ok");
  for (const std::uint64_t time : {9 * kSecond, 11 * kSecond})
    CHECK_EQ(kind_of(both, "a", "b", time), "extrapolation");
  // Nor is one in a chain whose other links have the time.
  for (const int s : {9, 10, 11}) both.set(transform_of("b", "c", s * kSecond, kIdentity), "");
  for (const std::uint64_t time : {9 * kSecond, 11 * kSecond}) {
    CHECK_EQ(kind_of(both, "a", "c", time), "extrapolation");
    CHECK_EQ(kind_of(both, "c", "a", time), "extrapolation");
    CHECK_EQ(kind_of(both, "b", "c", time), "ok");  // the link above is not used
  }
  check_all(both, {"a", "b", "c"}, kTimes);
}

TEST(the_link_above_a_common_parent_is_not_needed) {
  Both both;
  both.set(transform_of("root", "parent", 10 * kSecond, kIdentity), "");
  for (const int s : {20, 21}) {
    both.set(transform_of("parent", "a", s * kSecond, about_z(s, 0, 0)), "");
    both.set(transform_of("parent", "b", s * kSecond, about_z(0, s, 0)), "");
  }
  for (const auto& [to, from] : {std::pair("a", "b"), {"a", "a"}, {"a", "parent"}, {"parent", "b"}})
    CHECK_EQ(kind_of(both, to, from, 20 * kSecond + 1), "ok");
  CHECK_EQ(kind_of(both, "root", "a", 20 * kSecond + 1), "extrapolation");
}

TEST(the_latest_time_is_that_of_the_slowest_link) {
  Both both;
  both.set(transform_of("a", "b", 10 * kSecond, kIdentity), "");
  both.set(transform_of("b", "c", 12 * kSecond, kIdentity), "");
  const auto latest = [&](const std::string& target, const std::string& source) {
    const auto ours =
        outcome_of([&] { return both.ours.lookupTransform(target, source, ros::Time(0)); });
    check_same(
        outcome_of([&] { return both.theirs.lookupTransform(target, source, ros::Time(0)); }),
        ours);
    return ours.kind == "ok" ? ours.message.header.stamp.toNSec() : 0;
  };
  CHECK_EQ(latest("a", "b"), 10 * kSecond);
  CHECK_EQ(kind_of(both, "a", "c", 0), "extrapolation");  // they have no time in common
  for (const int s : {12, 13}) both.set(transform_of("a", "b", s * kSecond, kIdentity), "");
  CHECK_EQ(latest("a", "c"), 12 * kSecond);
  CHECK_EQ(latest("c", "a"), 12 * kSecond);
  both.set(transform_of("c", "d", 1, kIdentity), "", true);  // a static link has all times
  CHECK_EQ(latest("a", "d"), 12 * kSecond);
  CHECK_EQ(latest("c", "d"), 0u);
  CHECK_EQ(latest("d", "d"), latest("c", "c") * 0);
}

TEST(the_cache_keeps_its_time_and_no_more) {
  Both both;
  tf2::BufferCore theirs(ros::Duration(2));
  zenoh_tf::BufferCore ours(ros::Duration(2));
  for (int i = 0; i < 100; ++i) {
    const auto message = transform_of("a", "b", 10 * kSecond + i * kSecond / 10, about_z(i, 0, 0));
    CHECK_EQ(ours.setTransform(message, ""), theirs.setTransform(message, ""));
    for (const int back : {0, 5, 15, 19, 21, 25, 40}) {
      const ros::Time time =
          at(10 * kSecond + (i - back) * static_cast<std::int64_t>(kSecond) / 10);
      CHECK_EQ(ours.canTransform("a", "b", time), theirs.canTransform("a", "b", time));
    }
  }
  const auto late = transform_of("a", "b", 10 * kSecond, kIdentity);
  CHECK(!ours.setTransform(late, "") && !theirs.setTransform(late, ""));
  CHECK_EQ(ours.getCacheLength(), theirs.getCacheLength());
}

TEST(names_are_checked_alike) {
  Both both;
  set_moving(both, {{"a", "b"}, {"b", "c"}});
  for (const std::string name : {"a", "b", "c", "d", "/a", "/", ""}) {
    if (!name.empty() && name[0] != '/')
      CHECK_EQ(both.ours._frameExists(name), both.theirs._frameExists(name));
    for (const std::string other : {"a", "", "/b", "d"}) {
      kind_of(both, name, other, 11 * kSecond);
      kind_of(both, other, name, 11 * kSecond);
      check_same(outcome_of([&] {
                   return both.theirs.lookupTransform(name, at(11 * kSecond), "b", at(11 * kSecond),
                                                      other);
                 }),
                 outcome_of([&] {
                   return both.ours.lookupTransform(name, at(11 * kSecond), "b", at(11 * kSecond),
                                                    other);
                 }));
    }
  }
  Names theirs, ours;
  both.theirs._getFrameStrings(theirs), both.ours._getFrameStrings(ours);
  std::sort(theirs.begin(), theirs.end()), std::sort(ours.begin(), ours.end());
  CHECK(ours == theirs);
}

TEST(a_repeated_stamp_is_no_reason_for_nan) {
  Both both;
  for (const double x : {1.0, 2.0})
    both.theirs.setTransform(transform_of("a", "b", 4 * kSecond, about_z(x, 0, 0)), ""),
        both.ours.setTransform(transform_of("a", "b", 4 * kSecond, about_z(x, 0, 0)), "");
  const Pose ours = pose_of(both.ours.lookupTransform("a", "b", at(4 * kSecond)));
  CHECK_EQ(ours.x, 2);  // tf2 has either
  CHECK(!std::isnan(ours.qw));
}

TEST(a_request_is_answered_at_once_or_by_the_transform_that_it_waits_for) {
  Both both;
  set_moving(both, {{"a", "b"}});
  int their_calls = 0, our_calls = 0;
  const auto counts = [](int& calls) {
    return [&calls](tf2::TransformableRequestHandle, const std::string&, const std::string&,
                    ros::Time, tf2::TransformableResult) { ++calls; };
  };
  const auto theirs = both.theirs.addTransformableCallback(counts(their_calls));
  const auto ours = both.ours.addTransformableCallback(counts(our_calls));
  const auto ask = [&](std::uint64_t time, const std::string& source = "b") {
    const auto handle = both.ours.addTransformableRequest(ours, "a", source, at(time));
    CHECK_EQ(handle, both.theirs.addTransformableRequest(theirs, "a", source, at(time)));
    return handle;
  };
  CHECK_EQ(ask(11 * kSecond), 0u);  // it is there
  ask(1 * kSecond);                 // it is too old
  CHECK(ask(20 * kSecond) != 0);
  CHECK(ask(11 * kSecond, "later") != 0);
  both.set(transform_of("a", "b", 19 * kSecond, kIdentity), "");
  CHECK_EQ(our_calls, their_calls);
  both.set(transform_of("a", "b", 21 * kSecond, kIdentity), "");
  CHECK_EQ(our_calls, their_calls);
  both.set(transform_of("b", "later", 11 * kSecond, kIdentity), "");
  CHECK(our_calls >= 2);
  CHECK_EQ(our_calls, their_calls);
  both.ours.removeTransformableCallback(ours), both.theirs.removeTransformableCallback(theirs);
  both.set(transform_of("a", "b", 22 * kSecond, kIdentity), "");
  CHECK_EQ(our_calls, their_calls);
}
