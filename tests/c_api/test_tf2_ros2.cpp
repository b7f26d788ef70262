// zenoh_tf::BufferCore for ROS 2: its signatures are those that ros2/ states, which it is compiled
// with in the place of ROS 2. What it answers is checked beside the tf2 of ROS 1, by test_tf2.cpp.
#include <future>
#include <type_traits>

#include "check.hpp"
#include "hidden_owner.hpp"
#include "zenoh_tf/tf2_buffer_core.hpp"

namespace {

using geometry_msgs::msg::TransformStamped;
using tf2::TimePoint;
using Ours = zenoh_tf::BufferCore;
using Text = const std::string&;
using Names = std::vector<std::string>;

// The arguments convert to members of this type only if both classes have it.
template <class Signature>
constexpr bool both_have(Signature tf2::BufferCore::*, Signature Ours::*) {
  return true;
}
#define CHECK_MEMBER(name, ...) \
  static_assert(both_have<__VA_ARGS__>(&tf2::BufferCore::name, &Ours::name))

CHECK_MEMBER(clear, void());
CHECK_MEMBER(setTransform, bool(const TransformStamped&, Text, bool));
CHECK_MEMBER(lookupTransform, TransformStamped(Text, Text, const TimePoint&) const);
CHECK_MEMBER(lookupTransform,
             TransformStamped(Text, const TimePoint&, Text, const TimePoint&, Text) const);
CHECK_MEMBER(canTransform, bool(Text, Text, const TimePoint&, std::string*) const);
CHECK_MEMBER(canTransform,
             bool(Text, const TimePoint&, Text, const TimePoint&, Text, std::string*) const);
CHECK_MEMBER(getAllFrameNames, Names() const);
CHECK_MEMBER(allFramesAsYAML, std::string(TimePoint) const);
CHECK_MEMBER(allFramesAsYAML, std::string() const);
CHECK_MEMBER(allFramesAsString, std::string() const);
CHECK_MEMBER(addTransformableRequest,
             tf2::TransformableRequestHandle(const Ours::TransformableCallback&, Text, Text,
                                             TimePoint));
CHECK_MEMBER(cancelTransformableRequest, void(tf2::TransformableRequestHandle));
CHECK_MEMBER(setUsingDedicatedThread, void(bool));
CHECK_MEMBER(isUsingDedicatedThread, bool() const);
CHECK_MEMBER(_frameExists, bool(Text) const);
CHECK_MEMBER(_getParent, bool(Text, TimePoint, std::string&) const);
CHECK_MEMBER(_getFrameStrings, void(Names&) const);
CHECK_MEMBER(getCacheLength, tf2::Duration());
static_assert(std::is_same_v<Ours::TransformableCallback, tf2::BufferCore::TransformableCallback>);
static_assert(std::is_base_of_v<tf2::BufferCoreInterface, Ours> && !std::is_abstract_v<Ours>);
static_assert(Ours::MAX_GRAPH_DEPTH == tf2::BufferCore::MAX_GRAPH_DEPTH);
static_assert(std::is_constructible_v<Ours, tf2::Duration> &&
              std::is_default_constructible_v<Ours>);
static_assert(!std::is_convertible_v<tf2::Duration, Ours>);  // explicit, as tf2's

#ifdef TF2_OF_HUMBLE
using Backward = tf2::ExtrapolationException;
using Forward = tf2::ExtrapolationException;
using NoData = tf2::ExtrapolationException;
#else
using Backward = tf2::BackwardExtrapolationException;
using Forward = tf2::ForwardExtrapolationException;
using NoData = tf2::NoDataForExtrapolationException;
#endif

constexpr std::int64_t kSecond = 1'000'000'000;

TimePoint at(std::int64_t ns) { return TimePoint(tf2::Duration(ns)); }

TransformStamped transform_of(Text parent, Text child, std::int32_t sec, std::uint32_t nanosec,
                              double x) {
  TransformStamped out;
  out.header.frame_id = parent;
  out.header.stamp.sec = sec, out.header.stamp.nanosec = nanosec;
  out.child_frame_id = child;
  out.transform.translation.x = x;
  return out;
}

// The text of the exception, whose class must be this one.
template <class Exception, class Call>
std::string text_of(Call&& call) {
  try {
    call();
  } catch (const tf2::TransformException& error) {
    CHECK(typeid(error) == typeid(Exception));
    return error.what();
  }
  return "nothing was thrown";
}

}  // namespace

TEST(a_node_of_ros_2_asks_by_the_interface) {
  Ours buffer;
  for (const std::int32_t sec : {10, 11})
    CHECK(buffer.setTransform(transform_of("map", "base", sec, 500'000'000, sec), "odometry"));
  CHECK(buffer.setTransform(transform_of("base", "laser", 0, 0, 100), "urdf", true));
  CHECK(!buffer.setTransform(transform_of("map", "base", 0, 0, 0), "odometry"));  // too old
  const tf2::BufferCoreInterface& tf = buffer;
  const TransformStamped found = tf.lookupTransform("map", "laser", at(11 * kSecond));
  CHECK_EQ(found.header.frame_id + ' ' + found.child_frame_id, "map laser");
  CHECK_EQ(found.header.stamp.sec, 11);
  CHECK_EQ(found.header.stamp.nanosec, 0u);
  CHECK_NEAR(found.transform.translation.x, 110.5, 1e-12);
  const TransformStamped newest = tf.lookupTransform("map", "base", TimePoint());
  CHECK_EQ(newest.header.stamp.sec, 11);
  CHECK_EQ(newest.header.stamp.nanosec, 500'000'000u);
  CHECK_NEAR(tf.lookupTransform("base", at(10'500'000'000), "base", at(11'500'000'000), "map")
                 .transform.translation.x,
             1, 1e-12);
  CHECK(tf.getAllFrameNames() == (Names{"base", "map", "laser"}));
  std::string parent;
  CHECK(buffer._getParent("laser", TimePoint(), parent));
  CHECK_EQ(parent, "base");
  CHECK(buffer.getCacheLength() == std::chrono::seconds(10));
  CHECK_EQ(buffer.lookupTransform("map", "map", at(-1)).header.stamp.sec, -1);
  CHECK_EQ(buffer.lookupTransform("map", "map", at(-1)).header.stamp.nanosec, 999'999'999u);
  CHECK_EQ(buffer.lookupTransform("map", "map", at(-kSecond)).header.stamp.nanosec, 0u);
  buffer.clear();
  CHECK(!buffer.canTransform("map", "base", TimePoint()));
}

TEST(errors_have_the_classes_and_texts_of_ros_2) {
  Ours buffer;
  buffer.setTransform(transform_of("map", "base", 10, 0, 0), "");
  buffer.setTransform(transform_of("sun", "moon", 10, 0, 0), "");
  const auto look_up = [&](Text target, Text source, std::int64_t ns) {
    return [&buffer, target = std::string(target), source = std::string(source), ns] {
      buffer.lookupTransform(target, source, at(ns));
    };
  };
  const std::string link = ", when looking up transform from frame [base] to frame [map]";
  CHECK_EQ(text_of<NoData>(look_up("map", "base", 9 * kSecond)),
           "Lookup would require extrapolation at time 9.000000, but only time 10.000000 is in the "
           "buffer" +
               link);
  buffer.setTransform(transform_of("map", "base", 12, 0, 0), "");
  CHECK_EQ(text_of<Backward>(look_up("map", "base", 9'500'000'000)),
           "Lookup would require extrapolation into the past.  Requested time 9.500000 but the "
           "earliest data is at time 10.000000" +
               link);
  CHECK_EQ(text_of<Forward>(look_up("map", "base", 13 * kSecond)),
           "Lookup would require extrapolation into the future.  Requested time 13.000000 but the "
           "latest data is at time 12.000000" +
               link);
  (void)text_of<tf2::ConnectivityException>(look_up("map", "moon", 10 * kSecond));
  CHECK_EQ(text_of<tf2::LookupException>(look_up("map", "x", 1)),
           "\"x\" passed to lookupTransform argument source_frame does not exist. ");
  CHECK_EQ(text_of<tf2::InvalidArgumentException>(look_up("", "x", 1)),
           "Invalid argument \"\" passed to lookupTransform argument target_frame - in tf2 "
           "frame_ids cannot be empty");
  CHECK_EQ(text_of<tf2::InvalidArgumentException>(look_up("map", "/x", 1)),
           "Invalid argument \"/x\" passed to lookupTransform argument source_frame - in tf2 "
           "frame_ids cannot start with a '/'");
  const auto reason = [&](Text target, Text source) {
    std::string text = "replaced";
    CHECK(!buffer.canTransform(target, source, at(11 * kSecond), &text));
    return text;
  };
  CHECK_EQ(reason("map", "x"),
           "Invalid frame ID \"x\" passed to canTransform argument source_frame - frame does not "
           "exist");
  CHECK_EQ(reason("/map", "x"),
           "Invalid frame ID \"/map\" passed to canTransform argument target_frame - in tf2 "
           "frame_ids cannot start with a '/'");
  CHECK(!buffer.canTransform("", "x", at(1)));
  CHECK(buffer.canTransform("map", "base", at(11 * kSecond)));
  CHECK(!buffer.canTransform("map", at(11 * kSecond), "x", at(0), "base"));
}

TEST(all_frames_are_listed_as_by_ros_2) {
  Ours buffer;
  CHECK_EQ(buffer.allFramesAsYAML(), "[]");
  buffer.setTransform(transform_of("map", "base", 10, 0, 0), "odometry");
  buffer.setTransform(transform_of("map", "base", 12, 0, 0), "odometry");
  CHECK_EQ(buffer.allFramesAsYAML(at(12'250'000'000)),
           "base: \n  parent: 'map'\n  broadcaster: 'odometry'\n  rate: 1.000\n"
           "  most_recent_transform: 12.000000\n  oldest_transform: 10.000000\n"
           "  transform_delay: 0.250\n  buffer_length: 2.000\n");
  CHECK_EQ(buffer.allFramesAsString(), "Frame base exists with parent map.\n");
}

TEST(a_request_has_a_callback_of_its_own) {
  Ours buffer;
  Names called;
  const auto into = [&called](Text text) {
    return [&called, text = std::string(text)](tf2::TransformableRequestHandle, Text, Text,
                                               TimePoint, tf2::TransformableResult result) {
      called.push_back(text + (result == tf2::TransformAvailable ? " found" : " too old"));
    };
  };
  CHECK(buffer.addTransformableRequest(into("first"), "map", "base", at(20 * kSecond)) != 0);
  CHECK(buffer.addTransformableRequest(into("second"), "map", "base", at(5 * kSecond)) != 0);
  const auto third = buffer.addTransformableRequest(into("third"), "map", "base", at(20 * kSecond));
  buffer.cancelTransformableRequest(third);
  buffer.setTransform(transform_of("map", "base", 20, 0, 0), "");
  CHECK(called == (Names{"first found", "second too old"}));
  CHECK_EQ(buffer.addTransformableRequest(into("now"), "map", "base", at(20 * kSecond)), 0u);
  CHECK_EQ(buffer.addTransformableRequest(into("never"), "map", "base", at(1)), ~std::uint64_t{0});
}

TEST(a_request_to_a_servers_tree_is_answered) {
  HiddenOwner owner;
  Ours buffer(zenoh_tf::Tree::open("main", owner.folder()));
  std::promise<TimePoint> called;
  CHECK(buffer.addTransformableRequest(
            [&](tf2::TransformableRequestHandle, Text, Text, TimePoint time,
                tf2::TransformableResult) { called.set_value(time); },
            "map", "base", at(1000)) != 0);
  owner.set_x("map", "base", 1000, 5);
  CHECK(called.get_future().get() == at(1000));
  CHECK_EQ(buffer.lookupTransform("map", "base", at(1000)).transform.translation.x, 5);
}
