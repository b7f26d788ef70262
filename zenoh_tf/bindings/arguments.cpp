// Arguments from Python, validated.
#include "bindings/bindings.hpp"

namespace ztf {

nb::str str_of(std::string_view text) { return nb::str(text.data(), text.size()); }

nb::object bytes_of(const std::optional<std::string>& data) {
  if (!data) return nb::none();
  return nb::bytes(data->data(), data->size());
}

std::string_view text_of(nb::handle name, const char* field) {
  if (!PyUnicode_Check(name.ptr())) [[unlikely]]
    raise(nb::module_::import_("zenoh_tf.errors").attr("must_be_str")(field, name));
  Py_ssize_t size = 0;
  const char* const text = PyUnicode_AsUTF8AndSize(name.ptr(), &size);
  if (!text) {
    PyErr_Clear();
    raise_invalid(std::string(field) + " must be a str that UTF-8 can encode", field);
  }
  return {text, static_cast<std::size_t>(size)};
}

std::string_view frame_name_of(nb::handle name, const char* field) {
  const std::string_view text = text_of(name, field);
  if (!is_frame_name(text)) [[unlikely]]
    raise(*name_fault(text, field));
  return text;
}

nb::tuple names_of(const Options& options, nb::handle names, std::vector<std::string_view>& texts,
                   const char* field) {
  const nb::tuple kept = tuple_of(names);
  for (const nb::handle name : kept) texts.push_back(text_of(name, field));
  rejected_as_error([&] { check_name_bytes(options, texts); });
  return kept;
}

Stamp stamp_of(nb::handle stamp, const char* field) {
  if (stamp.is_none()) return kNoStamp;
  const nb::object integer = nb::steal(PyNumber_Index(stamp.ptr()));
  if (!integer.is_valid()) {
    PyErr_Clear();
    raise_invalid(std::string(field) + " must be an int of nanoseconds or None, not " +
                      nb::cast<std::string>(nb::repr(stamp)),
                  field);
  }
  const Stamp value = PyLong_AsLongLong(integer.ptr());
  if ((value == -1 && PyErr_Occurred()) || value == kNoStamp) {
    PyErr_Clear();
    raise_invalid(std::string(field) + " is " + nb::cast<std::string>(nb::repr(integer)) +
                      "; stamps are nanoseconds from -2^63 + 1 to 2^63 - 1",
                  field);
  }
  return value;
}

double timeout_of(nb::handle timeout_s) {
  const double seconds = PyFloat_AsDouble(timeout_s.ptr());
  if (seconds == -1.0 && PyErr_Occurred()) {
    PyErr_Clear();
    raise_invalid(
        "timeout_s must be a number of seconds, not " + nb::cast<std::string>(nb::repr(timeout_s)),
        "timeout_s");
  }
  return seconds;
}

Stamp max_gap_of(nb::handle max_gap_s) {
  if (max_gap_s.is_none()) return kNoGapLimit;
  const double seconds = PyFloat_AsDouble(max_gap_s.ptr());
  if (PyErr_Occurred() || !(seconds >= 0)) {
    PyErr_Clear();
    raise_invalid("max_gap_s must be 0 or more seconds, or None for no limit, not " +
                      nb::cast<std::string>(nb::repr(max_gap_s)),
                  "max_gap_s");
  }
  return static_cast<Stamp>(std::min(seconds * 1e9, 9e18));
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
    // numpy would also convert None, strings, times and complex numbers.
    real = nb::cast<bool>(numpy.attr("can_cast")(array.attr("dtype"), float64, "same_kind"));
  } catch (const nb::python_error& error) {
    if (!error.matches(PyExc_ValueError) && !error.matches(PyExc_TypeError)) throw;
  }
  if (!real) raise_invalid(std::string(field) + " must be an array of real numbers", field);
  return numpy.attr("ascontiguousarray")(array, float64);
}

nb::tuple tuple_of(nb::handle sequence) {
  const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(sequence.ptr()));
  if (!items.is_valid()) throw nb::python_error();
  return items;
}

}  // namespace ztf
