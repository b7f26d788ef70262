// zenoh_tf::BufferCore beside the real tf2::BufferCore: the same calls, the same answers.
//
// C++17, since ROS 1 messages need std::allocator::rebind.
#include <future>
#include <random>

#include "both.hpp"
#include "hidden_owner.hpp"

namespace {

// Two trees; no link gets two samples with one stamp.
void fill(Both& both, std::mt19937& random) {
  for (int n = 1; n < 30; ++n) {
    const std::string parent = n < 20 ? nth("f", n / 2) : nth("g", n / 3),
                      child = nth(n < 20 ? "f" : "g", n);
    const bool is_static = n % 7 == 0;
    const int samples = is_static ? 1 : static_cast<int>(random() % 20 + 1);
    for (int i = 0; i < samples; ++i)
      both.set(
          transform_of(parent, child, 10 * kSecond + i * kSecond / 10 + n % 4, random_pose(random)),
          nth("authority", n % 3), is_static);
  }
}

std::string random_name(std::mt19937& random) {
  const unsigned n = random() % 36;
  if (n == 32) return "";
  if (n == 33) return "/f3";
  return nth(n < 20 ? "f" : "g", n);  // some do not exist
}
std::uint64_t random_time(std::mt19937& random) {
  return random() % 6 == 0 ? 0 : 9 * kSecond + random() % (4 * kSecond);
}

}  // namespace

TEST(random_lookups_are_answered_as_by_tf2) {
  std::mt19937 random(1);
  Both both;
  fill(both, random);
  for (int i = 0; i < 100'000; ++i) {
    const std::string target = random_name(random), source = random_name(random);
    const ros::Time time = at(random_time(random));
    check_same(outcome_of([&] { return both.theirs.lookupTransform(target, source, time); }),
               outcome_of([&] { return both.ours.lookupTransform(target, source, time); }));
    std::string their_text, our_text;
    CHECK_EQ(both.ours.canTransform(target, source, time, &our_text),
             both.theirs.canTransform(target, source, time, &their_text));
    CHECK_EQ(without_link(our_text), without_link(their_text));
    CHECK_EQ(both.ours._frameExists(target), both.theirs._frameExists(target));
  }
}

TEST(random_lookups_at_two_times_are_answered_as_by_tf2) {
  std::mt19937 random(2);
  Both both;
  fill(both, random);
  for (int i = 0; i < 50'000; ++i) {
    const std::string target = random_name(random), source = random_name(random),
                      fixed = random_name(random);
    const ros::Time target_time = at(random_time(random)), source_time = at(random_time(random));
    check_same(outcome_of([&] {
                 return both.theirs.lookupTransform(target, target_time, source, source_time,
                                                    fixed);
               }),
               outcome_of([&] {
                 return both.ours.lookupTransform(target, target_time, source, source_time, fixed);
               }));
    std::string their_text, our_text;
    CHECK_EQ(
        both.ours.canTransform(target, target_time, source, source_time, fixed, &our_text),
        both.theirs.canTransform(target, target_time, source, source_time, fixed, &their_text));
    const bool exist = both.theirs._frameExists(target) && both.theirs._frameExists(source) &&
                       both.theirs._frameExists(fixed);
    if (exist) CHECK_EQ(without_link(our_text), without_link(their_text));
  }
}

// With one link, it is the one that the text names.
TEST(a_text_has_the_times_of_the_link) {
  Both both;
  const auto check_at = [&](std::uint64_t time) {
    const Outcome theirs =
        outcome_of([&] { return both.theirs.lookupTransform("a", "b", at(time)); });
    CHECK_EQ(theirs.kind, "extrapolation");
    CHECK_EQ(outcome_of([&] { return both.ours.lookupTransform("a", "b", at(time)); }).text,
             theirs.text);
  };
  const Pose one{0, 0, 0, 0, 0, 0, 1};
  both.set(transform_of("a", "b", 11 * kSecond + 5, one), "");
  check_at(12 * kSecond);
  both.set(transform_of("a", "b", 13 * kSecond + 7, one), "");
  check_at(14 * kSecond + 123'456'789);
  check_at(9 * kSecond);
}

TEST(frames_are_listed_as_by_tf2) {
  std::mt19937 random(3);
  Both both;
  CHECK_EQ(both.ours.allFramesAsYAML(), both.theirs.allFramesAsYAML());
  CHECK_EQ(both.ours.allFramesAsString(), both.theirs.allFramesAsString());
  fill(both, random);
  CHECK_EQ(both.ours.allFramesAsYAML(), both.theirs.allFramesAsYAML());
  CHECK_EQ(both.ours.allFramesAsYAML(13.5), both.theirs.allFramesAsYAML(13.5));
  CHECK_EQ(both.ours.allFramesAsString(), both.theirs.allFramesAsString());
  for (int n = 0; n < 30; ++n)
    for (const std::uint64_t time : {std::uint64_t{0}, 9 * kSecond, 10 * kSecond + 500}) {
      std::string their_parent, our_parent;
      const std::string name = nth(n < 20 ? "f" : "g", n);
      CHECK_EQ(both.ours._getParent(name, at(time), our_parent),
               both.theirs._getParent(name, at(time), their_parent));
      CHECK_EQ(our_parent, their_parent);
    }
}

TEST(bad_transforms_are_refused_as_by_tf2) {
  Both both;
  const Pose one{0, 0, 0, 0, 0, 0, 1};
  both.set(transform_of("a", "a", kSecond, one), "");
  both.set(transform_of("", "a", kSecond, one), "");
  both.set(transform_of("/", "a", kSecond, one), "");
  both.set(transform_of("a", "", kSecond, one), "");
  both.set(transform_of("a", "b", kSecond, {NAN, 0, 0, 0, 0, 0, 1}), "");
  both.set(transform_of("a", "b", kSecond, {0, 0, 0, 0, 0, 0, 0}), "");
  both.set(transform_of("a", "b", kSecond, {0, 0, 0, 0, 0, 0, 1.1}), "");
  both.set(transform_of("/a", "/b", 2000 * kSecond, one), "");
  both.set(transform_of("a", "b", 1000 * kSecond, one), "");
  both.set(transform_of("a", "b", 999 * kSecond, one), "");  // too old
  both.ours.clear(), both.theirs.clear();
  CHECK_EQ(both.ours.canTransform("a", "b", at(0)), both.theirs.canTransform("a", "b", at(0)));
}

TEST(requests_are_answered_as_by_tf2) {
  std::mt19937 random(4);
  Both both;
  std::vector<std::string> theirs, ours;
  const auto into = [](std::vector<std::string>& log) {
    return [&log](tf2::TransformableRequestHandle request, const std::string& target,
                  const std::string& source, ros::Time, tf2::TransformableResult) {
      // tf2 passes the time and the result by references that no longer refer to them.
      log.push_back(std::to_string(request) + ' ' + target + ' ' + source);
    };
  };
  const auto their_callback = both.theirs.addTransformableCallback(into(theirs));
  const auto our_callback = both.ours.addTransformableCallback(into(ours));
  for (int i = 0; i < 3000; ++i) {
    const std::string parent = nth("f", random() % 5), child = nth("h", random() % 5);
    if (i % 3 == 0)
      both.set(transform_of(parent, child, kSecond * (1 + i), {0, 0, 0, 0, 0, 0, 1}), "");
    const ros::Time time = at(kSecond * (random() % 200 + i));
    const auto their_request =
        both.theirs.addTransformableRequest(their_callback, parent, child, time);
    const auto our_request = both.ours.addTransformableRequest(our_callback, parent, child, time);
    CHECK_EQ(our_request, their_request);
    if (i % 5 == 0) {
      both.theirs.cancelTransformableRequest(their_request);
      both.ours.cancelTransformableRequest(our_request);
    }
    std::sort(theirs.begin(), theirs.end());  // tf2 calls those of one transform in no order
    std::sort(ours.begin(), ours.end());
    CHECK(ours == theirs);
  }
  CHECK(theirs.size() > 100);
}

TEST(a_buffer_of_a_servers_tree_answers_and_calls_back) {
  HiddenOwner owner;
  zenoh_tf::BufferCore buffer(zenoh_tf::Tree::open("main", owner.folder()));
  std::promise<tf2::TransformableResult> called;
  const auto callback = buffer.addTransformableCallback(
      [&](tf2::TransformableRequestHandle, const std::string&, const std::string&, ros::Time,
          tf2::TransformableResult result) { called.set_value(result); });
  CHECK(buffer.addTransformableRequest(callback, "map", "base", at(1000)) != 0);
  owner.set_x("map", "base", 1000, 5);
  CHECK_EQ(called.get_future().get(), tf2::TransformAvailable);
  CHECK_EQ(buffer.lookupTransform("map", "base", at(1000)).transform.translation.x, 5);
  CHECK(!buffer.setTransform(transform_of("map", "base", 2000, {0, 0, 0, 0, 0, 0, 1}), ""));
  CHECK_EQ(buffer.addTransformableRequest(callback, "map", "base", at(1000)), 0u);
}
