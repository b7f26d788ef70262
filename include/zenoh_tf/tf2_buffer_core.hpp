// tf2::BufferCore over a tree: of this process, or a server's. A node changes the type of its
// buffer; with a server's tree it needs no listener, and keeps no copy of the transforms.
//
// For ROS 1 (tf2 0.7): needs tf2's headers, and not its library. Answers, the classes of exceptions
// and their texts are tf2's. On purpose these differ:
//  - setTransform() also returns false for an infinite number, and for a link that would close a
//    cycle; a repeated stamp replaces the transform; nothing is logged.
//  - A dynamic transform stamped 0 is one at time 0, not one to be ignored.
//  - Where several links have no data for a time, the text names the one that is farthest from it,
//    and that of canTransform() at two times names each frame that does not exist once.
//  - Of a server's tree, setTransform() returns false and clear() does nothing: the tree has other
//    publishers. Callbacks of requests then come from a thread of the buffer, each millisecond.
//  - Left out is what only tf::Transformer needs: numbers of frames, dot graphs, _chainAsVector().
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
#include <boost/signals2.hpp>

#include "zenoh_tf/zenoh_tf.hpp"

namespace zenoh_tf {

class BufferCore {
 public:
  static const int DEFAULT_CACHE_TIME = 10;  // seconds
  static const std::uint32_t MAX_GRAPH_DEPTH = 1000UL;
  typedef tf2::BufferCore::TransformableCallback TransformableCallback;

  explicit BufferCore(ros::Duration cache_time = ros::Duration(DEFAULT_CACHE_TIME))
      : tree_(make_tree(cache_time)), is_own_(true), cache_time_(cache_time) {}
  // A server's tree. The cache time is that of the server.
  explicit BufferCore(Tree server_tree,
                      ros::Duration cache_time = ros::Duration(DEFAULT_CACHE_TIME))
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

  bool setTransform(const geometry_msgs::TransformStamped& transform, const std::string& authority,
                    bool is_static = false) {
    const geometry_msgs::Vector3& t = transform.transform.translation;
    const geometry_msgs::Quaternion& q = transform.transform.rotation;
    const ztf_transform row = {transform.header.frame_id.c_str(),
                               transform.child_frame_id.c_str(),
                               ns_of(transform.header.stamp),
                               {t.x, t.y, t.z, q.x, q.y, q.z, q.w}};
    std::int32_t stored = 0;
    if (ztf_set(tree_.get(), &row, authority.c_str(), is_static ? ZTF_STATIC : 0, &stored,
                nullptr) != ZTF_OK ||
        !stored)
      return false;
    testTransformableRequests();
    transforms_changed_();
    return true;
  }

  geometry_msgs::TransformStamped lookupTransform(const std::string& target_frame,
                                                  const std::string& source_frame,
                                                  const ros::Time& time) const {
    if (target_frame == source_frame) return identity(target_frame, time);
    Answer answer;
    ztf_error error = new_error();
    if (ztf_lookup(tree_.get(), target_frame.c_str(), source_frame.c_str(), stamp_of(time), nullptr,
                   &answer, &error) == ZTF_OK)
      return message(target_frame, source_frame, answer);
    validate("lookupTransform argument target_frame", target_frame);
    validate("lookupTransform argument source_frame", source_frame);
    raise(error);
  }

  geometry_msgs::TransformStamped lookupTransform(const std::string& target_frame,
                                                  const ros::Time& target_time,
                                                  const std::string& source_frame,
                                                  const ros::Time& source_time,
                                                  const std::string& fixed_frame) const {
    Answer answer;
    ztf_error error = new_error();
    if (ztf_lookup_full(tree_.get(), target_frame.c_str(), stamp_of(target_time),
                        source_frame.c_str(), stamp_of(source_time), fixed_frame.c_str(), nullptr,
                        &answer, &error) == ZTF_OK)
      return message(target_frame, source_frame, answer);
    validate("lookupTransform argument target_frame", target_frame);
    validate("lookupTransform argument source_frame", source_frame);
    validate("lookupTransform argument fixed_frame", fixed_frame);
    raise(error);
  }

  bool canTransform(const std::string& target_frame, const std::string& source_frame,
                    const ros::Time& time, std::string* error_msg = nullptr) const {
    if (target_frame == source_frame) return true;
    for (const std::string* name : {&target_frame, &source_frame})
      if (!is_valid(*name)) return false;
    const bool exist = all_exist({{"target", &target_frame}, {"source", &source_frame}}, error_msg);
    return exist && can(target_frame, source_frame, time, error_msg);
  }

  bool canTransform(const std::string& target_frame, const ros::Time& target_time,
                    const std::string& source_frame, const ros::Time& source_time,
                    const std::string& fixed_frame, std::string* error_msg = nullptr) const {
    for (const std::string* name : {&target_frame, &source_frame, &fixed_frame})
      if (!is_valid(*name)) return false;
    const bool exist = all_exist(
        {{"target", &target_frame}, {"source", &source_frame}, {"fixed", &fixed_frame}}, error_msg);
    return exist && can(target_frame, fixed_frame, target_time, error_msg) &&
           can(fixed_frame, source_frame, source_time, error_msg);
  }

  std::string allFramesAsYAML(double current_time) const {
    std::ostringstream text;
    text.precision(3);
    text << std::fixed;
    const std::vector<std::string> names = tree_.frames();
    if (names.empty()) return "{}";
    for (const std::string& name : names) {
      ztf_frame_info info;
      if (!find_info(name, info) || info.samples == 0) continue;
      const bool is_static = (info.flags & ZTF_STATIC) != 0;  // whose times tf2 shows as 0
      const double newest = is_static ? 0 : time_of(info.newest_stamp_ns).toSec();
      const double oldest = is_static ? 0 : time_of(info.oldest_stamp_ns).toSec();
      text << name << ": \n  parent: '" << info.parent << "'\n  broadcaster: '" << info.authority
           << "'\n  rate: " << info.samples / std::max(newest - oldest, 0.0001)
           << "\n  most_recent_transform: " << newest << "\n  oldest_transform: " << oldest << "\n";
      if (current_time > 0) text << "  transform_delay: " << current_time - newest << "\n";
      text << "  buffer_length: " << newest - oldest << "\n";
    }
    return text.str();
  }
  std::string allFramesAsYAML() const { return allFramesAsYAML(0.0); }

  std::string allFramesAsString() const {
    std::string text;
    for (const std::string& name : tree_.frames()) {
      ztf_frame_info info;
      if (find_info(name, info) && info.samples != 0)
        text += "Frame " + name + " exists with parent " + info.parent + ".\n";
    }
    return text;
  }

  tf2::TransformableCallbackHandle addTransformableCallback(const TransformableCallback& callback) {
    const std::lock_guard<std::mutex> lock(mutex_);
    callbacks_[++last_callback_] = callback;
    return last_callback_;
  }
  void removeTransformableCallback(tf2::TransformableCallbackHandle handle) {
    const std::lock_guard<std::mutex> lock(mutex_);
    callbacks_.erase(handle);
    erase_requests([&](const Request& request) { return request.callback == handle; });
  }
  // Returns 0 if the transform is there already, and all bits if it can never come.
  tf2::TransformableRequestHandle addTransformableRequest(tf2::TransformableCallbackHandle handle,
                                                          const std::string& target_frame,
                                                          const std::string& source_frame,
                                                          ros::Time time) {
    if (target_frame == source_frame) return 0;
    const Request request = {0, handle, target_frame, source_frame, time};
    const Outcome outcome = outcome_of(request);
    if (outcome == Outcome::available) return 0;
    if (outcome == Outcome::too_old) return ~tf2::TransformableRequestHandle{0};
    tf2::TransformableRequestHandle number;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      requests_.push_back(request);
      number = requests_.back().number = ++last_request_;
      if (!is_own_ && !poller_.joinable()) poller_ = std::thread([this] { poll(); });
    }
    changed_.notify_all();
    if (is_own_) testTransformableRequests();  // a transform may have come since
    return number;
  }
  void cancelTransformableRequest(tf2::TransformableRequestHandle handle) {
    const std::lock_guard<std::mutex> lock(mutex_);
    erase_requests([&](const Request& request) { return request.number == handle; });
  }

  void setUsingDedicatedThread(bool value) { using_dedicated_thread_ = value; }
  bool isUsingDedicatedThread() const { return using_dedicated_thread_; }

  // Called after each setTransform().
  boost::signals2::connection _addTransformsChangedListener(boost::function<void(void)> callback) {
    return transforms_changed_.connect(callback);
  }
  void _removeTransformsChangedListener(boost::signals2::connection connection) {
    connection.disconnect();
  }
  bool _frameExists(const std::string& name) const {
    ztf_frame frame;
    return ztf_resolve(tree_.get(), name.c_str(), &frame, nullptr) == ZTF_OK;
  }
  bool _getParent(const std::string& name, ros::Time time, std::string& parent) const {
    if (!_frameExists(name)) return false;
    const std::string found = tree_.parent(name, stamp_of(time));
    if (found.empty()) return false;
    parent = found;
    return true;
  }
  void _getFrameStrings(std::vector<std::string>& names) const { names = tree_.frames(); }
  ros::Duration getCacheLength() { return cache_time_; }

  // For functions of zenoh_tf.h and zenoh_tf.hpp.
  Tree& tree() noexcept { return tree_; }

 private:
  enum class Outcome { available, too_old, may_come };
  struct Request {
    tf2::TransformableRequestHandle number;
    tf2::TransformableCallbackHandle callback;
    std::string target, source;
    ros::Time time;
  };

  static Tree make_tree(ros::Duration cache_time) {
    Options options;
    options.cache_time_ns = cache_time.toNSec();
    return Tree(options);
  }
  static Stamp ns_of(const ros::Time& time) { return static_cast<Stamp>(time.toNSec()); }
  // tf2's 0 is the latest.
  static Stamp stamp_of(const ros::Time& time) { return time.isZero() ? kNoStamp : ns_of(time); }
  static ros::Time time_of(Stamp stamp) {
    ros::Time time;
    return time.fromNSec(static_cast<std::uint64_t>(stamp));
  }
  static ztf_error new_error() {
    ztf_error error;
    error.size = sizeof error;
    return error;
  }
  static bool is_valid(const std::string& name) { return !name.empty() && name[0] != '/'; }

  static geometry_msgs::TransformStamped message(const std::string& target,
                                                 const std::string& source, const Answer& answer) {
    geometry_msgs::TransformStamped out;
    out.header.stamp = time_of(answer.stamp_ns);
    out.header.frame_id = target;
    out.child_frame_id = source;
    const Pose& p = answer.pose;
    out.transform.translation.x = p.x;
    out.transform.translation.y = p.y;
    out.transform.translation.z = p.z;
    out.transform.rotation.x = p.qx;
    out.transform.rotation.y = p.qy;
    out.transform.rotation.z = p.qz;
    out.transform.rotation.w = p.qw;
    return out;
  }
  // Of a frame in itself, which need not exist.
  geometry_msgs::TransformStamped identity(const std::string& name, const ros::Time& time) const {
    Answer answer;
    answer.pose.qw = 1;
    answer.stamp_ns = ns_of(time);
    ztf_frame_info info;
    if (time.isZero() && find_info(name, info) && info.samples != 0 && !(info.flags & ZTF_STATIC))
      answer.stamp_ns = info.newest_stamp_ns;
    return message(name, name, answer);
  }
  bool find_info(const std::string& name, ztf_frame_info& info) const {
    info.size = sizeof info;
    return ztf_info(tree_.get(), name.c_str(), &info, nullptr) == ZTF_OK;
  }

  // Throws tf2's exception for a name that no frame has.
  void validate(const char* argument, const std::string& name) const {
    if (name.empty())
      throw tf2::InvalidArgumentException(std::string("Invalid argument passed to ") + argument +
                                          " in tf2 frame_ids cannot be empty");
    if (name[0] == '/')
      throw tf2::InvalidArgumentException("Invalid argument \"" + name + "\" passed to " +
                                          argument +
                                          " in tf2 frame_ids cannot start with a '/' like: ");
    if (!_frameExists(name))
      throw tf2::LookupException("\"" + name + "\" passed to " + argument + " does not exist. ");
  }

  static std::string formatted(const char* format, double a, double b, double c = 0) {
    char text[256];
    std::snprintf(text, sizeof text, format, a, b, c);
    return text;
  }
  // The text of tf2 for an error.
  std::string text_of(const ztf_error& error) const {
    const auto seconds = [](Stamp stamp) { return time_of(stamp).toSec(); };
    const double asked = error.stamp_ns == kNoStamp ? 0 : seconds(error.stamp_ns);
    const std::string target = error.target_frame, source = error.source_frame;
    const std::string where =
        ", when looking up transform from frame [" + source + "] to frame [" + target + "]";
    switch (error.code) {
      case ZTF_NO_DATA:
        return formatted(
                   "Lookup would require extrapolation at time %.09f, but only time %.09f is in "
                   "the buffer",
                   asked, seconds(error.newest_stamp_ns)) +
               where;
      case ZTF_FORWARD:
        return formatted(
                   "Lookup would require extrapolation %.09fs into the future.  Requested time "
                   "%.09f but the latest data is at time %.09f",
                   seconds(error.stamp_ns - error.newest_stamp_ns), asked,
                   seconds(error.newest_stamp_ns)) +
               where;
      case ZTF_BACKWARD:
        return formatted(
                   "Lookup would require extrapolation %.09fs into the past.  Requested time "
                   "%.09f but the earliest data is at time %.09f",
                   seconds(error.oldest_stamp_ns - error.stamp_ns), asked,
                   seconds(error.oldest_stamp_ns)) +
               where;
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
      case ZTF_NO_DATA:
      case ZTF_FORWARD:
      case ZTF_BACKWARD:
        throw tf2::ExtrapolationException(text);
      default:
        throw tf2::TransformException(text);
    }
  }

  // Says which names no frame has.
  bool all_exist(std::initializer_list<std::pair<const char*, const std::string*>> names,
                 std::string* error_msg) const {
    std::string text;
    for (const auto& each : names)
      if (!_frameExists(*each.second))
        text += (text.empty() ? "canTransform: " : " canTransform: ") + std::string(each.first) +
                "_frame " + *each.second + " does not exist.";
    if (error_msg) *error_msg += text;
    return text.empty();
  }
  // Of valid names.
  bool can(const std::string& target, const std::string& source, const ros::Time& time,
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
    if (is_valid(request.target) && is_valid(request.source) &&
        can(request.target, request.source, request.time, nullptr))
      return Outcome::available;
    if (is_known && latest != kNoStamp && request.time + cache_time_ < time_of(latest))
      return Outcome::too_old;
    return Outcome::may_come;
  }
  template <class Condition>
  void erase_requests(Condition&& condition) {
    requests_.erase(std::remove_if(requests_.begin(), requests_.end(), condition), requests_.end());
  }
  void testTransformableRequests() {
    std::vector<std::pair<Request, Outcome>> done;
    std::vector<TransformableCallback> callbacks;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      erase_requests([&](const Request& request) {
        const Outcome outcome = outcome_of(request);
        if (outcome == Outcome::may_come) return false;
        done.emplace_back(request, outcome);
        return true;
      });
      for (const auto& each : done) {
        const auto found = callbacks_.find(each.first.callback);
        callbacks.push_back(found == callbacks_.end() ? TransformableCallback() : found->second);
      }
    }
    for (std::size_t i = 0; i < done.size(); ++i) {
      const Request& r = done[i].first;
      if (callbacks[i])
        callbacks[i](
            r.number, r.target, r.source, r.time,
            done[i].second == Outcome::available ? tf2::TransformAvailable : tf2::TransformFailure);
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
  const ros::Duration cache_time_;
  bool using_dedicated_thread_ = false;
  boost::signals2::signal<void(void)> transforms_changed_;
  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  std::map<tf2::TransformableCallbackHandle, TransformableCallback> callbacks_;
  std::vector<Request> requests_;
  tf2::TransformableCallbackHandle last_callback_ = 0;
  tf2::TransformableRequestHandle last_request_ = 0;
  bool closing_ = false;
  std::thread poller_;
};

}  // namespace zenoh_tf
