// decode_tf_message: a ROS 2 tf2_msgs/TFMessage in CDR as TransformRows;
// decode_tf_messages: many of them, as recordings have them.
//
// GIL: released for a large message.
#include "messages/cdr.hpp"

#include "bindings/commits/transform_rows.hpp"

namespace ztf {

namespace {

constexpr std::size_t kReleaseFrom = 64 * 1024;  // bytes from which releasing the GIL pays

// Returns a name as a text. One that is no UTF-8 gets its bytes as escapes and a zero at its end,
// which no frame's name has, so that a commit refuses the row and no other.
nb::object text_of_name(std::string_view name) {
  const auto decode = [](std::string_view bytes, const char* errors) {
    return nb::steal(
        PyUnicode_DecodeUTF8(bytes.data(), static_cast<Py_ssize_t>(bytes.size()), errors));
  };
  const nb::object text = decode(name, "strict");
  if (text.is_valid()) return text;
  PyErr_Clear();
  const nb::object shown = decode(std::string(name) + '\0', "backslashreplace");
  if (!shown.is_valid()) throw nb::python_error();  // no memory
  return shown;
}

// Appends the names that are not in the list yet.
void append_names(const TfMessageScan& scan, nb::list& names) {
  while (names.size() < scan.names.size()) names.append(text_of_name(scan.names[names.size()]));
}

// The rows, or (field, what was expected) of a malformed message. `rename` gives the frames their
// names in the tree.
nb::object decode_tf_message(const nb::bytes& message, nb::handle rename) {
  TfMessageScan scan;
  std::optional<MalformedCdr> fault;
  without_gil_if(message.size() >= kReleaseFrom, [&] {
    try {
      scan.run(view_of(message));
    } catch (const MalformedCdr& malformed) {
      fault = malformed;
    }
  });
  if (fault) return nb::make_tuple(fault->field, fault->expected);
  nb::list names;
  append_names(scan, names);
  if (!rename.is_none()) {
    names = nb::cast<nb::list>(rename(names));
    if (names.size() != scan.names.size()) raise_invalid("rename must keep their number", "names");
  }
  return nb::cast(TransformRows(std::move(names), std::move(scan.rows)));
}

// (rows, number of malformed messages, field, what was expected) of many messages. A malformed one
// has no rows; the last two are of the first.
nb::tuple decode_tf_messages(const nb::list& messages) {
  TfMessageScan scan;
  nb::list names;
  std::size_t malformed_messages = 0;
  MalformedCdr first;
  for (const nb::handle message : messages) {
    const nb::bytes data = nb::cast<nb::bytes>(message);  // the list keeps it alive
    const std::size_t rows_before = scan.rows.size(), names_before = scan.names.size();
    try {
      scan.run(view_of(data));
    } catch (const MalformedCdr& malformed) {
      if (malformed_messages++ == 0) first = malformed;
      scan.cut(rows_before, names_before);
    }
  }
  append_names(scan, names);
  return nb::make_tuple(TransformRows(std::move(names), std::move(scan.rows)), malformed_messages,
                        first.field, first.expected);
}

}  // namespace

void bind_cdr(nb::module_& m) {
  m.def("decode_tf_message", &decode_tf_message, nb::arg("message"),
        nb::arg("rename").none() = nb::none());
  m.def("decode_tf_messages", &decode_tf_messages, nb::arg("messages"));
}

}  // namespace ztf
