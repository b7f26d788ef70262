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
  MessageWriter& text(std::string_view text) {
    return head({0xa0, 32, 0xd9, 0xda, 0xdb}, text.size()).raw(text);
  }
  MessageWriter& binary(std::string_view bytes) {
    return head({0, 0, 0xc4, 0xc5, 0xc6}, bytes.size()).raw(bytes);
  }
  // An entry of a map with the bytes of a column, at a multiple of 8 from the begin. Before it
  // comes an entry of the empty key, with as many bytes as that takes.
  MessageWriter& column(std::string_view key, std::string_view bytes) {
    const std::size_t heads = 3 + key.size() + 1 +
                              (bytes.size() < 1 << 8    ? 2
                               : bytes.size() < 1 << 16 ? 3
                                                        : 5);
    const std::string_view padding("\0\0\0\0\0\0\0", (0 - (out_.size() + heads)) % 8);
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

  MessageWriter& head(const Forms& forms, std::size_t size) {
    if (size < forms.fixed_below) return byte(forms.fixed | size);
    const bool is_one = forms.one != 0 && size < 1 << 8, is_two = size < 1 << 16;
    byte(is_one ? forms.one : is_two ? forms.two : forms.four);
    for (int bits = is_one ? 8 : is_two ? 16 : 32; bits != 0; bits -= 8) byte(size >> (bits - 8));
    return *this;
  }
  MessageWriter& byte(std::size_t value) {
    out_.push_back(static_cast<char>(value));
    return *this;
  }

  std::string out_;
};

}  // namespace ztf
