// Writes MessagePack, one part after the other.
//
// Thread safety: an object is for one thread.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

namespace ztf {

// Every function may throw bad_alloc. Sizes must be below 2^32.
class MessageWriter {
 public:
  // `bytes`: about what will be written.
  explicit MessageWriter(std::size_t bytes = 0) { out_.reserve(bytes); }
  MessageWriter& raw(std::string_view bytes) {
    out_.append(bytes);
    return *this;
  }
  // A value as columns have it, little-endian.
  template <class T>
  MessageWriter& entry(const T& value) {
    return raw({reinterpret_cast<const char*>(&value), sizeof value});
  }
  MessageWriter& text(std::string_view text) { return head(kText, text.size()).raw(text); }
  MessageWriter& binary(std::string_view bytes) { return head(kBinary, bytes.size()).raw(bytes); }
  // An entry of a map with the bytes of a column, at a multiple of 8 from the begin. Before it
  // comes an entry of the empty key, with as many bytes as that takes.
  MessageWriter& column(std::string_view key, std::string_view bytes) {
    const std::string_view zeros("\0\0\0\0\0\0\0", 7);
    const std::size_t heads = head_bytes(kText, 0) + head_bytes(kBinary, zeros.size()) +
                              head_bytes(kText, key.size()) + key.size() +
                              head_bytes(kBinary, bytes.size());
    const std::string_view padding = zeros.substr(0, (0 - (out_.size() + heads)) % 8);
    return text("").binary(padding).text(key).binary(bytes);
  }
  MessageWriter& list(std::size_t entries) { return head({0x90, 16, 0, 0xdc, 0xdd}, entries); }
  MessageWriter& map(std::size_t keys) { return head({0x80, 16, 0, 0xde, 0xdf}, keys); }

  std::string take() { return std::move(out_); }

 private:
  // The first byte of a value: with its size, if that is below `fixed_below`, or before a size of
  // one, two or four bytes. 0: there is no such form.
  struct Forms {
    std::uint8_t fixed, fixed_below, one, two, four;
  };

  static constexpr Forms kText{0xa0, 32, 0xd9, 0xda, 0xdb}, kBinary{0, 0, 0xc4, 0xc5, 0xc6};

  static constexpr std::size_t head_bytes(const Forms& forms, std::size_t size) noexcept {
    if (size < forms.fixed_below) return 1;
    return forms.one != 0 && size < 1 << 8 ? 2 : size < 1 << 16 ? 3 : 5;
  }
  MessageWriter& head(const Forms& forms, std::size_t size) {
    const std::size_t bytes = head_bytes(forms, size);
    if (bytes == 1) return byte(forms.fixed | size);
    byte(bytes == 2 ? forms.one : bytes == 3 ? forms.two : forms.four);
    for (std::size_t bits = 8 * (bytes - 1); bits != 0; bits -= 8) byte(size >> (bits - 8));
    return *this;
  }
  MessageWriter& byte(std::size_t value) {
    out_.push_back(static_cast<char>(value));
    return *this;
  }

  std::string out_;
};

}  // namespace ztf
