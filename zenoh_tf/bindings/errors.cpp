// Errors of the core as Python exceptions, and the GIL.
#include <algorithm>
#include <cstdio>

#include "base/host.hpp"
#include "bindings/lookup_error.hpp"

namespace ztf {

namespace {

// When to ask again for a frame of a server that has just started.
constexpr double kRetryAfterS = 0.1;

std::string ns(Stamp stamp) { return std::to_string(stamp) + " ns"; }

std::string seconds(Stamp duration) {
  char text[64];
  std::snprintf(text, sizeof text, "%.9g s", static_cast<double>(duration) * 1e-9);
  return text;
}

// A frame of a failure, which may have lost its name.
std::string frame_text(const std::string& name) {
  return name.empty() ? "a removed frame" : quoted(name);
}

// What is wrong with the link that has no data at the stamp asked for.
std::string extrapolation_message(const Failure& f, const std::string& link) {
  if (f.code == Code::gap)
    return "gap: " + link + " has no sample for " + seconds(f.newest - f.oldest) + ", from " +
           ns(f.oldest) + " to " + ns(f.newest) +
           (f.max_gap >= 0 ? ", and the limit is " + seconds(f.max_gap) + " (max_gap_s)"
                           : ", which is much longer than usual (max_gap_s allows it)");
  if (f.code == Code::no_data)
    return "extrapolation: " + link + " has a single sample, at " + ns(f.newest);
  const std::string range = link + " has samples from " + ns(f.oldest) + " to " + ns(f.newest);
  return f.code == Code::forward ? "extrapolation into the future: " + range
                                 : "extrapolation into the past: " + range;
}

// The message of a lookup without a time: the links have no time in common, as one has ended before
// the failing one begins.
std::string no_common_time(const Failure& f, const EndedLink& ended, const std::string& target,
                           const std::string& source, const std::string& failing) {
  std::string change;
  if (ended.was_static)
    change = "; it was static until " +
             (ended.authority.empty() ? "a publisher without a name" : quoted(ended.authority)) +
             " sent it as moving";
  return "extrapolation: the links between " + target + " and " + source +
         " have no time in common: the link from " + frame_text(ended.parent) + " to " +
         frame_text(ended.child) + " has no sample after " + ns(ended.newest) +
         text_from_python("zenoh_tf.text.stamp_units", "ended", ended.newest, f.oldest,
                          real_time_ns(), failing, change);
}

}  // namespace

nb::object make_error(Code code, const std::string& message, const nb::dict& facts) {
  const nb::object by_code = nb::module_::import_("zenoh_tf.errors").attr("BY_CODE");
  const nb::object kind = by_code[nb::int_(static_cast<int>(code))];
  const nb::tuple arguments = nb::make_tuple(message);
  nb::object error;
  block_if_thread_ends(
      [&] { error = nb::steal(PyObject_Call(kind.ptr(), arguments.ptr(), facts.ptr())); });
  if (!error.is_valid()) throw nb::python_error();
  return error;
}

nb::object make_error(const Rejected& r) {
  nb::dict facts;
  if (!r.frame.empty()) facts["frame"] = r.frame;
  if (!r.parent.empty()) facts["parent_frame"] = r.parent;
  if (!r.field.empty()) facts["field"] = r.field;
  if (r.stamp != kNoStamp) facts["stamp_ns"] = r.stamp;
  if (r.oldest != kNoStamp) facts["oldest_stamp_ns"] = r.oldest;
  if (r.newest != kNoStamp) facts["newest_stamp_ns"] = r.newest;
  if (r.limit >= 0) facts["limit"] = r.limit;
  if (r.value >= 0) facts["value"] = r.value;
  return make_error(r.code, r.message, facts);
}

nb::object make_memory_error() {
  return make_error(Rejected{.code = Code::limit,
                             .message = "the host has no memory left for the tree: free memory "
                                        "there, or bound the tree (max_memory)",
                             .field = "host_memory"});
}

nb::object unknown_frame(Startup startup, nb::handle name, nb::dict facts, const std::string& note,
                         const std::string& suggestion) {
  const std::string frame = "frame " + quoted(text_of(name, "frame"));
  facts["frame"] = name;
  if (startup.is_over())
    return make_error(Code::lookup, frame + " does not exist" + note + suggestion, facts);
  char age[32];
  std::snprintf(age, sizeof age, "%.1f s", static_cast<double>(startup.elapsed_ns) * 1e-9);
  facts["retry_after_s"] = kRetryAfterS;
  return make_error(Code::starting,
                    std::string("the server was started ") + age + " ago and has no " + frame +
                        " yet" + note +
                        ": its publisher may be coming back; try again, or wait with timeout_s",
                    facts);
}

nb::object make_error(const LookupError& e) {
  const Failure& f = e.failure;
  const auto& name_of = e.name_of;
  const std::string target_name = quoted(text_of(e.target, "target_frame"));
  const std::string source_name = quoted(text_of(e.source, "source_frame"));
  const std::string at = f.stamp == kNoStamp ? "" : " at " + ns(f.stamp);
  const std::string waited = e.note.waited.empty() ? "" : " (" + e.note.waited + ")";
  nb::dict facts;
  facts["target_frame"] = e.target;
  facts["source_frame"] = e.source;
  if (f.stamp != kNoStamp) facts["stamp_ns"] = f.stamp;
  std::string message;
  if (f.code == Code::lookup && f.frame == 0)
    return unknown_frame(e.startup, f.target == 0 ? e.target : e.source, facts, waited,
                         e.suggestion);
  if (f.code == Code::lookup) {
    if (const std::string frame = name_of(f.frame); !frame.empty()) facts["frame"] = frame;
    message = "the path between " + target_name + " and " + source_name + at;
    if (e.max_depth != 0) {
      facts["limit"] = e.max_depth;
      message += " is longer than the limit of " + std::to_string(e.max_depth) +
                 " links per side (max_depth), or";
    }
    message += " runs in a loop" + waited;
  } else if (f.code == Code::connectivity) {
    const std::string target_root = name_of(f.target_root);
    const std::string source_root = name_of(f.source_root);
    if (!target_root.empty()) facts["target_root"] = target_root;
    if (!source_root.empty()) facts["source_root"] = source_root;
    message = target_name + " and " + source_name + " are not connected" + at +
              ": their roots are " + frame_text(target_root) + " and " + frame_text(source_root) +
              waited;
  } else {
    std::string child = name_of(f.frame), parent = name_of(f.parent);
    const std::string link = "the link from " + frame_text(parent) + " to " + frame_text(child);
    if (e.ended) {
      message = no_common_time(f, *e.ended, target_name, source_name, link) + waited;
      child = e.ended->child, parent = e.ended->parent;
    } else {
      message = extrapolation_message(f, link) + ", but " + ns(f.stamp) +
                " was requested to look up " + source_name + " in " + target_name + e.note.carried +
                text_from_python("zenoh_tf.text.stamp_units", "beside", f.stamp, f.oldest, f.newest,
                                 e.note.waited, e.note.may_wait);
    }
    if (!child.empty()) facts["frame"] = child;
    if (!parent.empty()) facts["parent_frame"] = parent;
    facts["oldest_stamp_ns"] = e.ended ? e.ended->oldest : f.oldest;
    facts["newest_stamp_ns"] = e.ended ? e.ended->newest : f.newest;
    if (f.code == Code::gap) {
      facts["gap_ns"] = f.newest - f.oldest;
      if (f.max_gap >= 0) facts["limit"] = static_cast<double>(f.max_gap) * 1e-9;
    }
  }
  return make_error(f.code, message, facts);
}

std::string waited(double timeout_s) {
  const auto waited_ns = static_cast<std::int64_t>(std::min(timeout_s, 1e9) * 1e9);
  return "waited for " + text_from_python("zenoh_tf.text.times", "age", waited_ns);
}

void raise(const nb::object& error) {
  PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(error.ptr())), error.ptr());
  throw nb::python_error();
}

void raise_invalid(const std::string& message, const char* field) {
  nb::dict facts;
  facts["field"] = field;
  raise(make_error(Code::invalid_argument, message, facts));
}

bool is_main_thread() {
  const nb::module_ threading = nb::module_::import_("threading");
  return threading.attr("current_thread")().is(threading.attr("main_thread")());
}

GilReleased::GilReleased() : state_(PyEval_SaveThread()) {}

void GilReleasedOnWait::take_back() {
  block_if_thread_ends([&] { PyEval_RestoreThread(state_); });
}

GilReleased::~GilReleased() {
  block_if_thread_ends([&] { PyEval_RestoreThread(state_); });
}

}  // namespace ztf
