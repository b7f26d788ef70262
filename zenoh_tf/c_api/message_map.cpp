#include "c_api/message_map.hpp"

#include <bit>

#include "messages/cursor.hpp"

namespace ztf {

namespace {

using Kind = MessageHead::Kind;

bool skip_value(MessageCursor& cursor) {
  std::string_view bytes;
  for (std::uint64_t left = 1; left > 0; --left) {
    MessageHead head;
    if (!cursor.head(head)) return false;
    if (head.kind == Kind::list || head.kind == Kind::map) {
      if (head.size > cursor.left()) return false;
      left += head.kind == Kind::map ? 2 * head.size : head.size;
    } else if (!cursor.take(head.size, bytes)) {
      return false;
    }
  }
  return true;
}

// The big-endian digits of a number, of at most 8 bytes.
std::uint64_t digits_of(std::string_view bytes) {
  std::uint64_t digits = 0;
  for (const char byte : bytes) digits = digits << 8 | static_cast<unsigned char>(byte);
  return digits;
}

}  // namespace

bool MessageMap::is_map() const {
  MessageCursor cursor(bytes_);
  MessageHead head;
  return cursor.head(head) && head.kind == Kind::map;
}

std::optional<std::string_view> MessageMap::field(std::string_view name) const {
  MessageCursor cursor(bytes_);
  MessageHead head;
  if (!cursor.head(head) || head.kind != Kind::map) return std::nullopt;
  std::string_view key;
  for (std::uint64_t i = 0; i < head.size && cursor.text(key); ++i) {
    const std::string_view rest = bytes_.substr(bytes_.size() - cursor.left());
    if (!skip_value(cursor)) break;
    if (key == name) return rest.substr(0, rest.size() - cursor.left());
  }
  return std::nullopt;
}

std::optional<std::string_view> MessageMap::text(std::string_view name) const {
  MessageCursor cursor(field(name).value_or(""));
  std::string_view text;
  return cursor.text(text) ? std::optional(text) : std::nullopt;
}

std::optional<std::string_view> MessageMap::binary(std::string_view name) const {
  MessageCursor cursor(field(name).value_or(""));
  std::string_view bytes;
  return cursor.binary(bytes) ? std::optional(bytes) : std::nullopt;
}

std::optional<std::int64_t> MessageMap::integer(std::string_view name) const {
  const std::string_view value = field(name).value_or("");
  if (value.empty()) return std::nullopt;
  const auto first = static_cast<unsigned char>(value[0]);
  if (first < 0x80 || first >= 0xe0) return static_cast<signed char>(first);
  const std::uint64_t digits = digits_of(value.substr(1));
  if (first >= 0xcc && first <= 0xcf) return static_cast<std::int64_t>(digits);
  if (first < 0xd0 || first > 0xd3) return std::nullopt;
  const unsigned unused = 64 - (8u << (first - 0xd0));  // the bits above a signed number
  return static_cast<std::int64_t>(digits << unused) >> unused;
}

std::optional<double> MessageMap::real(std::string_view name) const {
  if (const std::optional<std::int64_t> whole = integer(name)) return static_cast<double>(*whole);
  const std::string_view value = field(name).value_or("");
  if (value.starts_with('\xcb')) return std::bit_cast<double>(digits_of(value.substr(1)));
  return std::nullopt;
}

}  // namespace ztf
