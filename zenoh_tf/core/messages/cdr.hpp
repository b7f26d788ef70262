// A ROS 2 tf2_msgs/TFMessage in CDR as rows.
//
// The scan reads untrusted bytes: every length is checked against what is left of the message
// before it is used.
//
// Thread safety: an object is for one thread.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "commits/request.hpp"

namespace ztf {

// What is wrong with a message, and with which field.
struct MalformedCdr {
  std::string field, expected;
};

class TfMessageScan {
 public:
  // Adds the rows of a message, which must outlive the scan. Throws MalformedCdr and bad_alloc;
  // what it has added by then stays, see `cut`.
  void run(std::string_view data);
  // Removes what was added behind these numbers of rows and names.
  void cut(std::size_t row_count, std::size_t name_count);

  std::vector<std::string_view> names;  // each once; they need not be UTF-8
  std::vector<Row> rows;

 private:
  [[nodiscard]] std::size_t left() const noexcept { return data_.size() - at_; }
  [[nodiscard]] MalformedCdr malformed(const char* field, const char* expected) const;
  void align(std::size_t to);
  template <class T>
  T number(const char* field);
  std::string_view text(const char* field);
  std::uint32_t index_of(std::string_view name);
  void read_row();
  double in(const char* group, const char* field);

  static constexpr std::uint32_t kNoRow = ~std::uint32_t{0};
  std::string_view data_;
  std::size_t at_ = 0;
  std::uint32_t row_ = kNoRow;
  bool swap_ = false;
  std::unordered_map<std::string_view, std::uint32_t> known_;
};

}  // namespace ztf
