// Errors of the core as Python exceptions, and the GIL.
#include "bindings/bindings.hpp"

namespace ztf {

nb::object make_error(const Rejected& r) {
  nb::dict facts;
  const auto add_text = [&](const char* name, const std::string& text) {
    if (!text.empty()) facts[name] = text;
  };
  const auto add = [&]<class T>(const char* name, T value, T none = -1) {
    if (value != none) facts[name] = value;
  };
  add_text("target_frame", r.target);
  add_text("source_frame", r.source);
  add_text("frame", r.frame);
  add_text("parent_frame", r.parent);
  add_text("target_root", r.target_root);
  add_text("source_root", r.source_root);
  add_text("field", r.field);
  add("stamp_ns", r.stamp, kNoStamp);
  add("oldest_stamp_ns", r.oldest, kNoStamp);
  add("newest_stamp_ns", r.newest, kNoStamp);
  add("gap_ns", r.gap);
  add("limit", r.limit);
  add("value", r.value);
  if (r.max_gap >= 0) facts["limit"] = static_cast<double>(r.max_gap) * 1e-9;
  add("retry_after_s", r.retry_after_s);
  const nb::object by_code = nb::module_::import_("zenoh_tf.errors").attr("BY_CODE");
  const nb::object kind = by_code[nb::int_(static_cast<int>(r.code))];
  const nb::tuple arguments = nb::make_tuple(r.message);
  nb::object error;
  block_if_thread_ends(
      [&] { error = nb::steal(PyObject_Call(kind.ptr(), arguments.ptr(), facts.ptr())); });
  if (!error.is_valid()) throw nb::python_error();
  return error;
}

nb::object make_memory_error() {
  return make_error(Rejected{.code = Code::limit,
                             .message = "the host has no memory left for the tree: free memory "
                                        "there, or bound the tree (max_memory)",
                             .field = "host_memory"});
}

void raise(const nb::object& error) {
  PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(error.ptr())), error.ptr());
  throw nb::python_error();
}

void raise(const Rejected& rejected) { raise(make_error(rejected)); }

void raise_invalid(const std::string& message, const char* field) {
  raise({.code = Code::invalid_argument, .message = message, .field = field});
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
