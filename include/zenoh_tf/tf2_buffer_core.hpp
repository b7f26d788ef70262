// tf2::BufferCore over a tree: of this process, or a server's. A node changes the type of its
// buffer; with a server's tree it needs no listener, and keeps no copy of the transforms.
//
// For ROS 1 (tf2 0.7) and ROS 2 (Humble to Jazzy): needs tf2's headers, and not its library.
// Answers, the classes of exceptions and their texts are tf2's. That of ROS 2 was compiled with a
// statement of its signatures (tests/c_api/ros2), and with no ROS 2 yet. On purpose these differ:
//  - setTransform() also returns false for an infinite number, and for a link that would close a
//    cycle; a repeated stamp replaces the transform; nothing is logged.
//  - A dynamic transform stamped 0 is one at time 0, not one to be ignored.
//  - Where several links have no data for a time, the text names the one that is farthest from it,
//    and that of canTransform() at two times names each frame that does not exist once.
//  - Of a server's tree, setTransform() returns false and clear() does nothing: the tree has other
//    publishers. Callbacks of requests then come from a thread of the buffer, each millisecond.
//  - Left out is what only tf::Transformer needs: numbers of frames, dot graphs, _chainAsVector();
//    and ROS 2's lookupVelocity().
//
// Thread safety: every function, from any thread. Callbacks run without a lock of the buffer.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <initializer_list>
#include <iomanip>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#if __has_include(<geometry_msgs/msg/transform_stamped.hpp>)
#define ZTF_TF2_OF_ROS2
#include <geometry_msgs/msg/transform_stamped.hpp>
#else
#include <boost/signals2.hpp>
#endif

#include "zenoh_tf/zenoh_tf.hpp"

// What tf2::X is where tf2 has no such kind of exception: it has them from Jazzy on.
namespace zenoh_tf_kinds {
typedef tf2::ExtrapolationException BackwardExtrapolationException, ForwardExtrapolationException,
    NoDataForExtrapolationException;
}
namespace tf2 {
using namespace zenoh_tf_kinds;
}

namespace zenoh_tf {

// What differs between ROS 1 and ROS 2.
namespace ros_types {

constexpr Stamp kSecond = 1000000000;
// As tf2 does it.
inline double seconds_of(Stamp stamp) {
  return static_cast<double>(stamp / kSecond) + 1e-9 * static_cast<double>(stamp % kSecond);
}
#ifdef ZTF_TF2_OF_ROS2
using tf2::Duration;
typedef tf2::TimePoint Time;
typedef geometry_msgs::msg::TransformStamped TransformStamped;
typedef tf2::BufferCoreInterface Interface;
constexpr bool kIsRos2 = true;
typedef Time YamlTime;
inline Duration seconds(int count) { return std::chrono::seconds(count); }
inline Stamp ns_of(Duration duration) { return duration.count(); }
inline Stamp ns_of(Time time) { return time.time_since_epoch().count(); }
inline double seconds_of(Time time) { return seconds_of(ns_of(time)); }
inline Stamp ns_of(const builtin_interfaces::msg::Time& t) { return t.sec * kSecond + t.nanosec; }
inline void set(builtin_interfaces::msg::Time& time, Stamp stamp) {
  time.nanosec = static_cast<std::uint32_t>((stamp % kSecond + kSecond) % kSecond);
  time.sec = static_cast<std::int32_t>((stamp - time.nanosec) / kSecond);
}
#else
using geometry_msgs::TransformStamped;
using ros::Duration;
using ros::Time;
struct Interface {};
constexpr bool kIsRos2 = false;
typedef double YamlTime;
inline double seconds_of(double seconds) { return seconds; }
inline Duration seconds(int count) { return Duration(count); }
inline Stamp ns_of(Duration duration) { return duration.toNSec(); }
inline Stamp ns_of(Time time) { return static_cast<Stamp>(time.toNSec()); }
inline void set(Time& time, Stamp stamp) { time.fromNSec(static_cast<std::uint64_t>(stamp)); }
#endif

}  // namespace ros_types

class BufferCore : public ros_types::Interface {
 public:
  typedef ros_types::Time Time;
  typedef ros_types::Duration Duration;
  typedef ros_types::TransformStamped TransformStamped;
  static constexpr bool kIsRos2 = ros_types::kIsRos2;
  static const int DEFAULT_CACHE_TIME = 10;  // seconds
  static const std::uint32_t MAX_GRAPH_DEPTH = 1000UL;
  typedef tf2::BufferCore::TransformableCallback TransformableCallback;

  explicit BufferCore(Duration cache_time = ros_types::seconds(DEFAULT_CACHE_TIME))
      : tree_(make_tree(cache_time)), is_own_(true), cache_time_(cache_time) {}
  // A server's tree. The cache time is that of the server.
  explicit BufferCore(Tree server_tree,
                      Duration cache_time = ros_types::seconds(DEFAULT_CACHE_TIME))
      : tree_(std::move(server_tree)), is_own_(false), cache_time_(cache_time) {}
  virtual ~BufferCore() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      closing_ = true;
    }
    changed_.notify_all();
    if (poller_.joinable()) poller_.join();
  }
  BufferCore(const BufferCore&) = delete;
  BufferCore& operator=(const BufferCore&) = delete;

  void clear() {
    if (is_own_) tree_.clear();
  }

  bool setTransform(const TransformStamped& transform, const std::string& authority,
                    bool is_static = false) {
    const auto& t = transform.transform.translation;
    const auto& q = transform.transform.rotation;
    const ztf_transform row = {transform.header.frame_id.c_str(),
                               transform.child_frame_id.c_str(),
                               ros_types::ns_of(transform.header.stamp),
                               {t.x, t.y, t.z, q.x, q.y, q.z, q.w}};
    std::int32_t stored = 0;
    if (ztf_set(tree_.get(), &row, authority.c_str(), is_static ? ZTF_STATIC : 0, &stored,
                nullptr) != ZTF_OK ||
        !stored)
      return false;
    testTransformableRequests();
#ifndef ZTF_TF2_OF_ROS2
    transforms_changed_();
#endif
    return true;
  }

  TransformStamped lookupTransform(const std::string& target_frame, const std::string& source_frame,
                                   const Time& time) const {
    if (target_frame == source_frame) return identity(target_frame, time);
    Answer answer;
    ztf_error error = new_error();
    if (ztf_lookup(tree_.get(), target_frame.c_str(), source_frame.c_str(), stamp_of(time), nullptr,
                   &answer, &error) == ZTF_OK)
      return message(target_frame, source_frame, answer);
    validate({{"target", &target_frame}, {"source", &source_frame}});
    raise(error);
  }

  TransformStamped lookupTransform(const std::string& target_frame, const Time& target_time,
                                   const std::string& source_frame, const Time& source_time,
                                   const std::string& fixed_frame) const {
    Answer answer;
    ztf_error error = new_error();
    if (ztf_lookup_full(tree_.get(), target_frame.c_str(), stamp_of(target_time),
                        source_frame.c_str(), stamp_of(source_time), fixed_frame.c_str(), nullptr,
                        &answer, &error) == ZTF_OK)
      return message(target_frame, source_frame, answer);
    validate({{"target", &target_frame}, {"source", &source_frame}, {"fixed", &fixed_frame}});
    raise(error);
  }

  bool canTransform(const std::string& target_frame, const std::string& source_frame,
                    const Time& time, std::string* error_msg = nullptr) const {
    if (target_frame == source_frame) return true;
    const bool exist = all_exist({{"target", &target_frame}, {"source", &source_frame}}, error_msg);
    return exist && can(target_frame, source_frame, time, error_msg);
  }

  bool canTransform(const std::string& target_frame, const Time& target_time,
                    const std::string& source_frame, const Time& source_time,
                    const std::string& fixed_frame, std::string* error_msg = nullptr) const {
    const bool exist = all_exist(
        {{"target", &target_frame}, {"source", &source_frame}, {"fixed", &fixed_frame}}, error_msg);
    return exist && can(target_frame, fixed_frame, target_time, error_msg) &&
           can(fixed_frame, source_frame, source_time, error_msg);
  }

  std::string allFramesAsYAML(ros_types::YamlTime current_time) const {
    const double now = ros_types::seconds_of(current_time);
    std::ostringstream text;
    text << std::fixed << std::setprecision(3);
    const int digits = kIsRos2 ? 6 : 3;  // of stamps
    const std::vector<std::string> names = tree_.frames();
    if (names.empty()) return kIsRos2 ? "[]" : "{}";
    for (const std::string& name : names) {
      ztf_frame_info info;
      if (!find_info(name, info) || info.samples == 0) continue;
      const bool is_static = (info.flags & ZTF_STATIC) != 0;  // whose times tf2 shows as 0
      const double newest = is_static ? 0 : ros_types::seconds_of(info.newest_stamp_ns);
      const double oldest = is_static ? 0 : ros_types::seconds_of(info.oldest_stamp_ns);
      text << name << ": \n  parent: '" << info.parent << "'\n  broadcaster: '" << info.authority
           << "'\n  rate: " << info.samples / std::max(newest - oldest, 0.0001)
           << std::setprecision(digits) << "\n  most_recent_transform: " << newest
           << "\n  oldest_transform: " << oldest << std::setprecision(3) << "\n";
      if (now > 0) text << "  transform_delay: " << now - newest << "\n";
      text << "  buffer_length: " << newest - oldest << "\n";
    }
    return text.str();
  }
  std::string allFramesAsYAML() const { return allFramesAsYAML(ros_types::YamlTime()); }

  std::string allFramesAsString() const {
    std::string text;
    for (const std::string& name : tree_.frames()) {
      ztf_frame_info info;
      if (find_info(name, info) && info.samples != 0)
        text += "Frame " + name + " exists with parent " + info.parent + ".\n";
    }
    return text;
  }

#ifdef ZTF_TF2_OF_ROS2
  // Returns 0 if the transform is there already, and all bits if it can never come.
  tf2::TransformableRequestHandle addTransformableRequest(const TransformableCallback& callback,
                                                          const std::string& target_frame,
                                                          const std::string& source_frame,
                                                          Time time) {
    return add_request({0, 0, callback, target_frame, source_frame, time});
  }
#else
  tf2::TransformableCallbackHandle addTransformableCallback(const TransformableCallback& callback) {
    const std::lock_guard<std::mutex> lock(mutex_);
    callbacks_[++last_callback_] = callback;
    return last_callback_;
  }
  void removeTransformableCallback(tf2::TransformableCallbackHandle handle) {
    const std::lock_guard<std::mutex> lock(mutex_);
    callbacks_.erase(handle);
    erase_requests([&](const Request& request) { return request.handle == handle; });
  }
  // Returns 0 if the transform is there already, and all bits if it can never come.
  tf2::TransformableRequestHandle addTransformableRequest(tf2::TransformableCallbackHandle handle,
                                                          const std::string& target_frame,
                                                          const std::string& source_frame,
                                                          Time time) {
    return add_request({0, handle, {}, target_frame, source_frame, time});
  }
  // Called after each setTransform().
  boost::signals2::connection _addTransformsChangedListener(boost::function<void(void)> callback) {
    return transforms_changed_.connect(callback);
  }
  void _removeTransformsChangedListener(boost::signals2::connection connection) {
    connection.disconnect();
  }
#endif
  void cancelTransformableRequest(tf2::TransformableRequestHandle handle) {
    const std::lock_guard<std::mutex> lock(mutex_);
    erase_requests([&](const Request& request) { return request.number == handle; });
  }

  void setUsingDedicatedThread(bool value) { using_dedicated_thread_ = value; }
  bool isUsingDedicatedThread() const { return using_dedicated_thread_; }

  bool _frameExists(const std::string& name) const {
    ztf_frame frame;
    return ztf_resolve(tree_.get(), name.c_str(), &frame, nullptr) == ZTF_OK;
  }
  bool _getParent(const std::string& name, Time time, std::string& parent) const {
    if (!_frameExists(name)) return false;
    const std::string found = tree_.parent(name, stamp_of(time));
    if (found.empty()) return false;
    parent = found;
    return true;
  }
  std::vector<std::string> getAllFrameNames() const { return tree_.frames(); }
  void _getFrameStrings(std::vector<std::string>& names) const { names = tree_.frames(); }
  Duration getCacheLength() { return cache_time_; }

  // For functions of zenoh_tf.h and zenoh_tf.hpp.
  Tree& tree() noexcept { return tree_; }

 private:
  typedef std::initializer_list<std::pair<const char*, const std::string*>> Names;
  enum class Outcome { available, too_old, may_come };
  struct Request {
    tf2::TransformableRequestHandle number;
    std::uint32_t handle;  // of the callback; 0 in ROS 2
    TransformableCallback callback;
    std::string target, source;
    Time time;
  };

  static Tree make_tree(Duration cache_time) {
    Options options;
    options.cache_time_ns = ros_types::ns_of(cache_time);
    return Tree(options);
  }
  // tf2's 0 is the latest.
  static Stamp stamp_of(const Time& time) {
    return ros_types::ns_of(time) == 0 ? kNoStamp : ros_types::ns_of(time);
  }
  static ztf_error new_error() {
    ztf_error error;
    error.size = sizeof error;
    return error;
  }

  static TransformStamped message(const std::string& target, const std::string& source,
                                  const Answer& answer) {
    TransformStamped out;
    ros_types::set(out.header.stamp, answer.stamp_ns);
    out.header.frame_id = target;
    out.child_frame_id = source;
    const Pose& p = answer.pose;
    auto& t = out.transform.translation;
    auto& q = out.transform.rotation;
    t.x = p.x, t.y = p.y, t.z = p.z;
    q.x = p.qx, q.y = p.qy, q.z = p.qz, q.w = p.qw;
    return out;
  }
  // Of a frame in itself, which need not exist.
  TransformStamped identity(const std::string& name, const Time& time) const {
    Answer answer;
    answer.pose.qw = 1;
    answer.stamp_ns = ros_types::ns_of(time);
    ztf_frame_info info;
    if (answer.stamp_ns == 0 && find_info(name, info) && info.samples != 0 &&
        !(info.flags & ZTF_STATIC))
      answer.stamp_ns = info.newest_stamp_ns;
    return message(name, name, answer);
  }
  bool find_info(const std::string& name, ztf_frame_info& info) const {
    info.size = sizeof info;
    return ztf_info(tree_.get(), name.c_str(), &info, nullptr) == ZTF_OK;
  }

  static const char* flaw_of(const std::string& name) {
    if (name.empty()) return "in tf2 frame_ids cannot be empty";
    return name[0] == '/' ? "in tf2 frame_ids cannot start with a '/'" : nullptr;
  }
  // Throws tf2's exception for the first name that no frame has.
  void validate(Names names) const {
    for (const auto& each : names) {
      const std::string& name = *each.second;
      const char* const flaw = flaw_of(name);
      if (!flaw && _frameExists(name)) continue;
      const std::string quoted = '"' + name + '"', argument = std::string(each.first) + "_frame",
                        to = " passed to lookupTransform argument " + argument;
      if (!flaw) throw tf2::LookupException(quoted + to + " does not exist. ");
      throw tf2::InvalidArgumentException(
          "Invalid argument" + (kIsRos2 || !name.empty() ? ' ' + quoted : "") + to +
          (kIsRos2 ? " - " : " ") + flaw + (kIsRos2 || name.empty() ? "" : " like: "));
    }
  }

  static std::string shown(Stamp stamp) {
    char text[64];
    std::snprintf(text, sizeof text, kIsRos2 ? "%.6f" : "%.09f", ros_types::seconds_of(stamp));
    return text;
  }
  // The text of tf2 for an error.
  std::string text_of(const ztf_error& error) const {
    const std::string target = error.target_frame, source = error.source_frame;
    const std::string asked = shown(error.stamp_ns == kNoStamp ? 0 : error.stamp_ns);
    const std::string where =
        ", when looking up transform from frame [" + source + "] to frame [" + target + "]";
    switch (error.code) {
      case ZTF_NO_DATA:
        return "Lookup would require extrapolation at time " + asked + ", but only time " +
               shown(error.newest_stamp_ns) + " is in the buffer" + where;
      case ZTF_FORWARD:
      case ZTF_BACKWARD: {
        const bool is_late = error.code == ZTF_FORWARD;
        const Stamp end = is_late ? error.newest_stamp_ns : error.oldest_stamp_ns;
        const Stamp beyond = is_late ? error.stamp_ns - end : end - error.stamp_ns;
        return "Lookup would require extrapolation " + (kIsRos2 ? "" : shown(beyond) + "s ") +
               (is_late ? "into the future" : "into the past") + ".  Requested time " + asked +
               " but the " + (is_late ? "latest" : "earliest") + " data is at time " + shown(end) +
               where;
      }
      case ZTF_CONNECTIVITY:
        return "Could not find a connection between '" + target + "' and '" + source +
               "' because they are not part of the same tree.Tf has two or more unconnected trees.";
      default:
        return error.message;
    }
  }
  [[noreturn]] void raise(const ztf_error& error) const {
    const std::string text = text_of(error);
    switch (error.code) {
      case ZTF_LOOKUP:
      case ZTF_SERVER_STARTING:
        throw tf2::LookupException(text);
      case ZTF_CONNECTIVITY:
        throw tf2::ConnectivityException(text);
      case ZTF_INVALID_ARGUMENT:
        throw tf2::InvalidArgumentException(text);
      case ZTF_EXTRAPOLATION:
        throw tf2::ExtrapolationException(text);
      case ZTF_NO_DATA:
        throw tf2::NoDataForExtrapolationException(text);
      case ZTF_FORWARD:
        throw tf2::ForwardExtrapolationException(text);
      case ZTF_BACKWARD:
        throw tf2::BackwardExtrapolationException(text);
      default:
        throw tf2::TransformException(text);
    }
  }

  // Says which names no frame has: of ROS 1 all that are good, of ROS 2 the first.
  bool all_exist(Names names, std::string* error_msg) const {
    std::string text;
    for (const auto& each : names) {
      const std::string &name = *each.second, argument = std::string(each.first) + "_frame ";
      const char* const flaw = flaw_of(name);
      if (!flaw && _frameExists(name)) continue;
      if (kIsRos2 && error_msg)
        *error_msg = "Invalid frame ID \"" + name + "\" passed to canTransform argument " +
                     argument + "- " + (flaw ? flaw : "frame does not exist");
      if (kIsRos2 || flaw) return false;
      text += (text.empty() ? "" : " ") + ("canTransform: " + argument) + name + " does not exist.";
    }
    if (error_msg) *error_msg += text;
    return text.empty();
  }
  // Of valid names.
  bool can(const std::string& target, const std::string& source, const Time& time,
           std::string* error_msg) const {
    if (target == source) return true;
    ztf_error error = new_error();
    const ztf_code code = ztf_lookup(tree_.get(), target.c_str(), source.c_str(), stamp_of(time),
                                     nullptr, nullptr, error_msg ? &error : nullptr);
    if (code != ZTF_OK && error_msg) *error_msg = text_of(error);
    return code == ZTF_OK;
  }

  // --- requests

  Outcome outcome_of(const Request& request) const {
    Stamp latest = kNoStamp;
    const bool is_known = ztf_common_time(tree_.get(), request.target.c_str(),
                                          request.source.c_str(), &latest, nullptr) == ZTF_OK;
    if (!flaw_of(request.target) && !flaw_of(request.source) &&
        can(request.target, request.source, request.time, nullptr))
      return Outcome::available;
    if (is_known && latest != kNoStamp &&
        ros_types::ns_of(request.time) + ros_types::ns_of(cache_time_) < latest)
      return Outcome::too_old;
    return Outcome::may_come;
  }
  tf2::TransformableRequestHandle add_request(Request request) {
    if (request.target == request.source) return 0;
    const Outcome outcome = outcome_of(request);
    if (outcome == Outcome::available) return 0;
    if (outcome == Outcome::too_old) return ~tf2::TransformableRequestHandle{0};
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      const auto found = callbacks_.find(request.handle);
      if (found != callbacks_.end()) request.callback = found->second;
      request.number = ++last_request_;
      requests_.push_back(request);
      if (!is_own_ && !poller_.joinable()) poller_ = std::thread([this] { poll(); });
    }
    changed_.notify_all();
    if (is_own_) testTransformableRequests();  // a transform may have come since
    return request.number;
  }
  template <class Condition>
  void erase_requests(Condition&& condition) {
    requests_.erase(std::remove_if(requests_.begin(), requests_.end(), condition), requests_.end());
  }
  void testTransformableRequests() {
    std::vector<std::pair<Request, Outcome>> done;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      erase_requests([&](const Request& request) {
        const Outcome outcome = outcome_of(request);
        if (outcome == Outcome::may_come) return false;
        done.emplace_back(request, outcome);
        return true;
      });
    }
    for (const auto& each : done) {
      const Request& r = each.first;
      if (r.callback)
        r.callback(
            r.number, r.target, r.source, r.time,
            each.second == Outcome::available ? tf2::TransformAvailable : tf2::TransformFailure);
    }
  }
  // While there are requests to a server's tree.
  void poll() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (!closing_) {
      if (requests_.empty()) {
        changed_.wait(lock);
        continue;
      }
      lock.unlock();
      testTransformableRequests();
      lock.lock();
      changed_.wait_for(lock, std::chrono::milliseconds(1), [this] { return closing_; });
    }
  }

  Tree tree_;
  const bool is_own_;
  const Duration cache_time_;
  bool using_dedicated_thread_ = false;
#ifndef ZTF_TF2_OF_ROS2
  boost::signals2::signal<void(void)> transforms_changed_;
  std::uint32_t last_callback_ = 0;  // guarded by mutex_
#endif
  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  std::map<std::uint32_t, TransformableCallback> callbacks_;
  std::vector<Request> requests_;
  tf2::TransformableRequestHandle last_request_ = 0;
  bool closing_ = false;
  std::thread poller_;
};

}  // namespace zenoh_tf
