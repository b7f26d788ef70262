// The Python module, and what its files share.
#include "bindings.hpp"

#include <chrono>
#include <cstdio>
#include <thread>

#if defined(__GLIBCXX__)
#include <cxxabi.h>
#endif

namespace ztf {

namespace {

// Python ends daemon threads that want the interpreter lock while the process
// ends: it unwinds them, which nanobind takes for an exception of its own, and
// aborts. What may take the lock back stays here instead, until the end.
template <class Body>
void or_stay(Body&& body) {
#if defined(__GLIBCXX__)
  try {
    body();
  } catch (abi::__forced_unwind&) {
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
  }
#else
  body();
#endif
}

}  // namespace

nb::object make_error(Code code, const std::string& message, const nb::dict& facts) {
  const nb::object by_code = nb::module_::import_("zenoh_tf.errors").attr("BY_CODE");
  const nb::object kind = by_code[nb::int_(static_cast<int>(code))];
  const nb::tuple arguments = nb::make_tuple(message);
  nb::object error;
  or_stay([&] { error = nb::steal(PyObject_Call(kind.ptr(), arguments.ptr(), facts.ptr())); });
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

nb::object make_error(const Tree& tree, const Failure& f, nb::handle target, nb::handle source,
                      const std::string& note) {
  const auto quoted = [](std::string_view name) {
    return std::string("'").append(name).append("'");
  };
  const std::string target_name(text_of(target, "target_frame"));
  const std::string source_name(text_of(source, "source_frame"));
  nb::dict facts;
  facts["target_frame"] = target;
  facts["source_frame"] = source;
  if (f.stamp != kNoStamp) facts["stamp_ns"] = f.stamp;
  const std::string at = f.stamp == kNoStamp ? "" : " at time " + std::to_string(f.stamp) + " ns";
  std::string message;
  if (f.code == Code::lookup && f.frame == 0) {
    const nb::handle missing = f.target == 0 ? target : source;
    facts["frame"] = missing;
    message = "frame " + quoted(f.target == 0 ? target_name : source_name) + " does not exist";
  } else if (f.code == Code::lookup) {
    facts["frame"] = std::string(tree.name(f.frame));
    facts["limit"] = tree.options().max_depth;
    message = "the way up from " + quoted(target_name) + " or " + quoted(source_name) +
              " is longer than " + std::to_string(tree.options().max_depth) +
              " links, or runs in a loop" + at;
  } else if (f.code == Code::connectivity) {
    const std::string target_root(tree.name(f.target_root)), source_root(tree.name(f.source_root));
    facts["target_root"] = target_root;
    facts["source_root"] = source_root;
    message = "no path joins " + quoted(target_name) + " and " + quoted(source_name) + at +
              ": the way up from " + quoted(target_name) + " ends at " + quoted(target_root) +
              ", that from " + quoted(source_name) + " at " + quoted(source_root) +
              ", and neither has a link to a parent";
  } else {
    const std::string child(tree.name(f.frame)), parent(tree.name(f.parent));
    facts["frame"] = child;
    facts["parent_frame"] = parent;
    facts["oldest_stamp_ns"] = f.oldest;
    facts["newest_stamp_ns"] = f.newest;
    const std::string link = "the link from " + quoted(parent) + " to " + quoted(child);
    switch (f.code) {
      case Code::forward:
        message = "extrapolation into the future: " + link + " has samples from " +
                  std::to_string(f.oldest) + " to " + std::to_string(f.newest);
        break;
      case Code::backward:
        message = "extrapolation into the past: " + link + " has samples from " +
                  std::to_string(f.oldest) + " to " + std::to_string(f.newest);
        break;
      default:
        message = "extrapolation: " + link + " has a single sample, at " + std::to_string(f.newest);
    }
    message += " ns, and " + std::to_string(f.stamp) + " ns was asked for, looking up " +
               quoted(source_name) + " in " + quoted(target_name);
  }
  return make_error(f.code, message + note, facts);
}

std::string waited(double timeout_s) {
  char text[64];
  std::snprintf(text, sizeof text, " (waited for %.9g s)", timeout_s);
  return text;
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

std::string_view text_of(nb::handle name, const char* field) {
  Py_ssize_t size = 0;
  const char* text =
      PyUnicode_Check(name.ptr()) ? PyUnicode_AsUTF8AndSize(name.ptr(), &size) : nullptr;
  if (!text) {
    PyErr_Clear();
    raise_invalid(std::string(field) + " must be a str that can be encoded in UTF-8", field);
  }
  return {text, static_cast<std::size_t>(size)};
}

FrameId frame_of(const Tree& tree, nb::handle name, const char* field) {
  const std::string_view text = text_of(name, field);
  if (text.empty()) raise_invalid(std::string(field) + " is empty", field);
  if (text[0] == '/') {
    nb::dict facts;
    facts["field"] = field;
    facts["frame"] = name;
    raise(make_error(Code::invalid_argument,
                     std::string(field) + ": frame names do not begin with '/': '" +
                         std::string(text) + "' is spelled '" + std::string(text.substr(1)) + "'",
                     facts));
  }
  return tree.find(text);
}

Stamp stamp_of(nb::handle stamp, const char* field) {
  if (stamp.is_none()) return kNoStamp;
  const Stamp value =
      PyLong_Check(stamp.ptr()) || PyIndex_Check(stamp.ptr())
          ? static_cast<Stamp>(PyLong_AsLongLong(nb::steal(PyNumber_Index(stamp.ptr())).ptr()))
          : -1;
  if (value == -1 && !PyErr_Occurred() &&
      !(PyLong_Check(stamp.ptr()) || PyIndex_Check(stamp.ptr())))
    raise_invalid(std::string(field) + " must be an int of nanoseconds, or None", field);
  if (PyErr_Occurred()) {
    PyErr_Clear();
    raise_invalid(std::string(field) + " is out of the range of 64 bits", field);
  }
  if (value == kNoStamp) raise_invalid(std::string(field) + " is out of range", field);
  return value;
}

void numbers_of(nb::handle values, double* out, Py_ssize_t n, const char* field) {
  const nb::object items = nb::steal(PySequence_Tuple(values.ptr()));
  bool good = items.is_valid() && PyTuple_Size(items.ptr()) == n;
  for (Py_ssize_t i = 0; good && i < n; ++i) {
    out[i] = PyFloat_AsDouble(PyTuple_GetItem(items.ptr(), i));
    good = !PyErr_Occurred();
  }
  if (!good) {
    PyErr_Clear();
    raise_invalid(std::string(field) + " must be " + std::to_string(n) + " numbers", field);
  }
}

Pose pose_of(nb::handle translation, nb::handle rotation) {
  Pose pose;
  numbers_of(translation, &pose.x, 3, "translation");
  numbers_of(rotation, &pose.qx, 4, "rotation");
  return pose;
}

nb::object doubles_of(nb::handle values, const char* field) {
  const nb::module_ numpy = nb::module_::import_("numpy");
  const nb::object float64 = numpy.attr("float64");
  nb::object array;
  bool real = false;
  try {
    array = numpy.attr("asarray")(values);
    // Not None, strings, times or complex numbers, which numpy would make into something.
    real = nb::cast<bool>(numpy.attr("can_cast")(array.attr("dtype"), float64, "same_kind"));
  } catch (const nb::python_error& error) {
    if (!error.matches(PyExc_ValueError) && !error.matches(PyExc_TypeError)) throw;
  }
  if (!real) raise_invalid(std::string(field) + " must be an array of real numbers", field);
  return numpy.attr("ascontiguousarray")(array, float64);
}

Query query_of(const Tree& tree, Op op, nb::handle target, nb::handle source) {
  return {op, frame_of(tree, target, "target_frame"), frame_of(tree, source, "source_frame")};
}

void commit(Tree& tree, const CommitRequest& request, std::span<std::uint8_t> stored,
            bool release_interpreter) {
  try {
    if (release_interpreter) {
      nb::gil_scoped_release released;
      tree.commit(request, stored);
    } else {
      tree.commit(request, stored);
    }
  } catch (const Rejected& refused) {
    raise(make_error(refused));
  }
}

bool is_main_thread() {
  const nb::module_ threading = nb::module_::import_("threading");
  return threading.attr("current_thread")().is(threading.attr("main_thread")());
}

Unlocked::Unlocked() : state_(PyEval_SaveThread()) {}

Unlocked::~Unlocked() {
  or_stay([&] { PyEval_RestoreThread(state_); });
}

}  // namespace ztf

NB_MODULE(_core, m) {
  m.doc() = "The native tree of zenoh-tf; use it through zenoh_tf.";
  // At exit, what daemon threads or a traceback still hold is no leak to tell a user about.
  nanobind::set_leak_warnings(false);
  ztf::bind_values(m);
  ztf::bind_tree(m);
  ztf::bind_waiting(m);
}
