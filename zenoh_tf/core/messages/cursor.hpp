// The folder `messages/`: messages that cost too much to be parsed in Python.
// In: bytes of others, which may be malformed. Out: views of them, rows, lookups; and back.
// It may include geometry, reads, commits.
//
// Reads MessagePack, one part after the other.
//
// Every length is checked against what is left of the message before it is used.
// Thread safety: an object is for one thread.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <vector>

namespace ztf {

inline bool is_utf8(std::string_view text) noexcept {
  const auto* at = reinterpret_cast<const unsigned char*>(text.data());
  const auto* const end = at + text.size();
  while (at != end) {
    const unsigned char head = *at++;
    if (head < 0x80) continue;
    if (head < 0xc2 || head > 0xf4) return false;
    // The second byte excludes overlong forms, surrogates and what is above U+10FFFF.
    unsigned char least = head == 0xe0 ? 0xa0 : head == 0xf0 ? 0x90 : 0x80;
    unsigned char most = head == 0xed ? 0x9f : head == 0xf4 ? 0x8f : 0xbf;
    for (int more = head < 0xe0 ? 1 : head < 0xf0 ? 2 : 3; more != 0; --more) {
      if (at == end || *at < least || *at > most) return false;
      ++at;
      least = 0x80;
      most = 0xbf;
    }
  }
  return true;
}

// What a value begins with.
struct MessageHead {
  enum class Kind : std::uint8_t { invalid, constant, number, text, binary, extension, list, map };
  Kind kind;
  std::uint64_t size;  // bytes that follow; of a list its entries, of a map its keys
};

// A function returns false if the message ends before, or continues otherwise.
class MessageCursor {
 public:
  explicit MessageCursor(std::string_view data) : rest_(data) {}

  [[nodiscard]] std::size_t left() const noexcept { return rest_.size(); }
  [[nodiscard]] bool at_end() const noexcept { return rest_.empty(); }

  bool raw(std::string_view bytes) {
    if (!rest_.starts_with(bytes)) return false;
    rest_.remove_prefix(bytes.size());
    return true;
  }
  bool take(std::uint64_t size, std::string_view& out) {
    if (rest_.size() < size) return false;
    out = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return true;
  }
  // A value as columns have it, little-endian.
  template <class T>
  bool entry(T& value) {
    std::string_view bytes;
    if (!take(sizeof value, bytes)) return false;
    std::memcpy(&value, bytes.data(), sizeof value);
    return true;
  }
  bool head(MessageHead& out);
  bool text(std::string_view& out) { return sized(MessageHead::Kind::text, out); }
  bool binary(std::string_view& out) { return sized(MessageHead::Kind::binary, out); }
  // The number of entries, each of which takes a byte at least: more are forged.
  bool list(std::size_t& entries) {
    MessageHead found;
    if (!head(found) || found.kind != MessageHead::Kind::list || found.size > left()) return false;
    entries = found.size;
    return true;
  }
  // A list of at most so many texts in UTF-8. Throws bad_alloc.
  bool names(std::size_t most, std::vector<std::string_view>& names) {
    std::size_t count = 0;
    if (!list(count) || count > most) return false;
    names.resize(count);
    return std::ranges::all_of(names,
                               [&](std::string_view& name) { return text(name) && is_utf8(name); });
  }

 private:
  // What 0xc0 to 0xdf begin: how long the number of the size is, and what is added to it.
  struct Form {
    MessageHead::Kind kind;
    std::uint8_t size_bytes, more;
  };

  bool sized(MessageHead::Kind kind, std::string_view& out) {
    MessageHead found;
    return head(found) && found.kind == kind && take(found.size, out);
  }

  std::string_view rest_;
};

inline bool MessageCursor::head(MessageHead& out) {
  using enum MessageHead::Kind;
  static constexpr std::array<Form, 32> kForms = {{
      {constant, 0, 0},   {invalid, 0, 0},   {constant, 0, 0},  {constant, 0, 0},
      {binary, 1, 0},     {binary, 2, 0},    {binary, 4, 0},    {extension, 1, 1},
      {extension, 2, 1},  {extension, 4, 1}, {number, 0, 4},    {number, 0, 8},
      {number, 0, 1},     {number, 0, 2},    {number, 0, 4},    {number, 0, 8},
      {number, 0, 1},     {number, 0, 2},    {number, 0, 4},    {number, 0, 8},
      {extension, 0, 2},  {extension, 0, 3}, {extension, 0, 5}, {extension, 0, 9},
      {extension, 0, 17}, {text, 1, 0},      {text, 2, 0},      {text, 4, 0},
      {list, 2, 0},       {list, 4, 0},      {map, 2, 0},       {map, 4, 0},
  }};
  if (rest_.empty()) return false;
  const auto first = static_cast<unsigned char>(rest_[0]);
  rest_.remove_prefix(1);
  if (first >= 0xa0 && first < 0xc0) {
    out = {text, first & 0x1fu};
  } else if (first < 0x80 || first >= 0xe0) {
    out = {constant, 0};  // a small number
  } else if (first < 0xa0) {
    out = {first < 0x90 ? map : list, first & 0x0fu};
  } else {
    const Form& form = kForms[first - 0xc0];
    std::string_view digits;
    if (form.kind == invalid || !take(form.size_bytes, digits)) return false;
    std::uint64_t size = 0;
    for (const char digit : digits) size = size << 8 | static_cast<unsigned char>(digit);
    out = {form.kind, size + form.more};
  }
  return true;
}

}  // namespace ztf
