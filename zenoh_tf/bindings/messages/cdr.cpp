// decode_tf_message: a ROS 2 tf2_msgs/TFMessage in CDR as TransformRows;
// decode_tf_messages: many of them, as recordings have them.
//
// The scan reads untrusted bytes: every length is checked against what is left of the message
// before it is used. It holds no references to Python, so it runs without the GIL on large ones.
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <unordered_map>

#include "bindings/commits/transform_rows.hpp"

namespace ztf {

namespace {

constexpr std::size_t kHeader = 4;               // the encapsulation; alignment counts from its end
constexpr std::size_t kMinRow = 8 + 4 + 4 + 56;  // stamp, two empty names, seven numbers
constexpr std::size_t kMaxPadding = 3;           // behind the last row, up to a multiple of four
constexpr std::size_t kReleaseFrom = 64 * 1024;  // bytes from which releasing the GIL pays
constexpr std::int64_t kSecond = 1'000'000'000;

// What is wrong, and with which field.
struct Malformed {
  std::string field, expected;
};

template <class T>
T byte_swapped(T value) {
  unsigned char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  std::reverse(bytes, bytes + sizeof(T));
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

class Scan {
 public:
  // Adds the rows of a message, which must outlive the scan. Throws Malformed; what it has added by
  // then stays, see `cut`.
  void run(std::string_view data) {
    data_ = data;
    row_ = kNoRow;
    if (data_.size() < kHeader || data_[0] != 0 || (data_[1] != 0 && data_[1] != 1))
      throw Malformed{"encapsulation", "00 00 or 00 01: plain CDR"};
    swap_ = data_[1] == 0;  // big-endian; the project runs on little-endian machines only
    at_ = kHeader;
    const std::uint32_t count = number<std::uint32_t>("transforms");
    if (count > left() / kMinRow)
      throw Malformed{"transforms",
                      "a count that the message has room for, not " + std::to_string(count)};
    if (rows.empty()) rows.reserve(count);  // further messages make it grow as they need
    for (row_ = 0; row_ < count; ++row_) read_row();
    if (left() > kMaxPadding)
      throw Malformed{
          "message", "nothing behind the last transform, not " + std::to_string(left()) + " bytes"};
  }

  // Removes what was added behind these numbers of rows and names.
  void cut(std::size_t row_count, std::size_t name_count) {
    rows.resize(row_count);
    while (names.size() > name_count) {
      known_.erase(names.back());
      names.pop_back();
    }
  }

  std::vector<std::string_view> names;  // each once
  std::vector<Row> rows;

 private:
  [[nodiscard]] std::size_t left() const noexcept { return data_.size() - at_; }
  [[nodiscard]] Malformed malformed(const char* field, const char* expected) const {
    if (row_ == kNoRow) return {field, expected};
    return {"transforms[" + std::to_string(row_) + "]." + field, expected};
  }

  void align(std::size_t to) {
    const std::size_t used = (at_ - kHeader) % to;
    if (used != 0) at_ = std::min(data_.size(), at_ + to - used);
  }
  template <class T>
  T number(const char* field) {
    align(sizeof(T));
    if (left() < sizeof(T)) throw malformed(field, "complete: the message ends before");
    T value;
    std::memcpy(&value, data_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return swap_ ? byte_swapped(value) : value;
  }
  std::string_view text(const char* field) {
    const std::uint32_t size = number<std::uint32_t>(field);  // with the zero at the end
    if (size > left()) throw malformed(field, "a text that the message has room for");
    if (size == 0) return {};  // some encoders write an empty text without its zero
    const std::string_view found = data_.substr(at_, size - 1);
    if (data_[at_ + size - 1] != '\0') throw malformed(field, "a text with a zero at its end");
    at_ += size;
    return found;
  }
  std::uint32_t index_of(std::string_view name) {
    const auto [at, is_new] = known_.try_emplace(name, static_cast<std::uint32_t>(names.size()));
    if (is_new) names.push_back(name);
    return at->second;
  }
  void read_row() {
    const auto seconds = number<std::int32_t>("header.stamp.sec");
    const auto rest = number<std::uint32_t>("header.stamp.nanosec");
    const std::uint32_t parent = index_of(text("header.frame_id"));
    const std::uint32_t child = index_of(text("child_frame_id"));
    std::array<double, 7> pose;
    double* number = pose.data();
    for (const char* field : {"x", "y", "z"}) *number++ = in("transform.translation.", field);
    for (const char* field : {"x", "y", "z", "w"}) *number++ = in("transform.rotation.", field);
    const Stamp stamp = rest < kSecond ? seconds * kSecond + rest : kNoStamp;  // refused by itself
    rows.push_back({parent, child, stamp, std::bit_cast<Pose>(pose)});
  }
  double in(const char* group, const char* field) {
    align(sizeof(double));
    if (left() < sizeof(double))
      throw malformed((std::string(group) + field).c_str(), "complete: the message ends before");
    return number<double>(field);
  }

  static constexpr std::uint32_t kNoRow = ~std::uint32_t{0};
  std::string_view data_;
  std::size_t at_ = 0;
  std::uint32_t row_ = kNoRow;
  bool swap_ = false;
  std::unordered_map<std::string_view, std::uint32_t> known_;
};

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
void append_names(const Scan& scan, nb::list& names) {
  while (names.size() < scan.names.size()) names.append(text_of_name(scan.names[names.size()]));
}

// The rows, or (field, what was expected) of a malformed message. `rename` gives the frames their
// names in the tree.
nb::object decode_tf_message(const nb::bytes& message, nb::handle rename) {
  Scan scan;
  std::optional<Malformed> fault;
  without_gil_if(message.size() >= kReleaseFrom, [&] {
    try {
      scan.run({message.c_str(), message.size()});
    } catch (const Malformed& malformed) {
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
  Scan scan;
  nb::list names;
  std::size_t malformed_messages = 0;
  Malformed first;
  for (const nb::handle message : messages) {
    const nb::bytes data = nb::cast<nb::bytes>(message);  // the list keeps it alive
    const std::size_t rows_before = scan.rows.size(), names_before = scan.names.size();
    try {
      scan.run({data.c_str(), data.size()});
    } catch (const Malformed& malformed) {
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
