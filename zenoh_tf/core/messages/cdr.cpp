#include "messages/cdr.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

namespace ztf {

namespace {

constexpr std::size_t kHeader = 4;               // the encapsulation; alignment counts from its end
constexpr std::size_t kMinRow = 8 + 4 + 4 + 56;  // stamp, two empty names, seven numbers
constexpr std::size_t kMaxPadding = 3;           // behind the last row, up to a multiple of four
constexpr std::int64_t kSecondNs = 1'000'000'000;

template <class T>
T byte_swapped(T value) {
  unsigned char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  std::reverse(bytes, bytes + sizeof(T));
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

}  // namespace

void TfMessageScan::run(std::string_view data) {
  data_ = data;
  row_ = kNoRow;
  if (data_.size() < kHeader || data_[0] != 0 || (data_[1] != 0 && data_[1] != 1))
    throw MalformedCdr{"encapsulation", "00 00 or 00 01: plain CDR"};
  swap_ = data_[1] == 0;  // big-endian; the project runs on little-endian machines only
  at_ = kHeader;
  const std::uint32_t count = number<std::uint32_t>("transforms");
  if (count > left() / kMinRow)
    throw MalformedCdr{"transforms",
                       "a count that the message has room for, not " + std::to_string(count)};
  if (rows.empty()) rows.reserve(count);  // further messages make it grow as they need
  for (row_ = 0; row_ < count; ++row_) read_row();
  if (left() > kMaxPadding)
    throw MalformedCdr{
        "message", "nothing behind the last transform, not " + std::to_string(left()) + " bytes"};
}

void TfMessageScan::cut(std::size_t row_count, std::size_t name_count) {
  rows.resize(row_count);
  while (names.size() > name_count) {
    known_.erase(names.back());
    names.pop_back();
  }
}

MalformedCdr TfMessageScan::malformed(const char* field, const char* expected) const {
  if (row_ == kNoRow) return {field, expected};
  return {"transforms[" + std::to_string(row_) + "]." + field, expected};
}

void TfMessageScan::align(std::size_t to) {
  const std::size_t used = (at_ - kHeader) % to;
  if (used != 0) at_ = std::min(data_.size(), at_ + to - used);
}

template <class T>
T TfMessageScan::number(const char* field) {
  align(sizeof(T));
  if (left() < sizeof(T)) throw malformed(field, "complete: the message ends before");
  T value;
  std::memcpy(&value, data_.data() + at_, sizeof(T));
  at_ += sizeof(T);
  return swap_ ? byte_swapped(value) : value;
}

std::string_view TfMessageScan::text(const char* field) {
  const std::uint32_t size = number<std::uint32_t>(field);  // with the zero at the end
  if (size > left()) throw malformed(field, "a text that the message has room for");
  if (size == 0) return {};  // some encoders write an empty text without its zero
  const std::string_view found = data_.substr(at_, size - 1);
  if (data_[at_ + size - 1] != '\0') throw malformed(field, "a text with a zero at its end");
  at_ += size;
  return found;
}

std::uint32_t TfMessageScan::index_of(std::string_view name) {
  const auto [at, is_new] = known_.try_emplace(name, static_cast<std::uint32_t>(names.size()));
  if (is_new) names.push_back(name);
  return at->second;
}

void TfMessageScan::read_row() {
  const auto seconds = number<std::int32_t>("header.stamp.sec");
  const auto rest = number<std::uint32_t>("header.stamp.nanosec");
  const std::uint32_t parent = index_of(text("header.frame_id"));
  const std::uint32_t child = index_of(text("child_frame_id"));
  std::array<double, 7> pose;
  double* number = pose.data();
  for (const char* field : {"x", "y", "z"}) *number++ = in("transform.translation.", field);
  for (const char* field : {"x", "y", "z", "w"}) *number++ = in("transform.rotation.", field);
  const Stamp stamp =
      rest < kSecondNs ? seconds * kSecondNs + rest : kNoStamp;  // refused by itself
  rows.push_back({parent, child, stamp, std::bit_cast<Pose>(pose)});
}

double TfMessageScan::in(const char* group, const char* field) {
  align(sizeof(double));
  if (left() < sizeof(double))
    throw malformed((std::string(group) + field).c_str(), "complete: the message ends before");
  return number<double>(field);
}

}  // namespace ztf
