// A seeded hash of names.
//
// It multiplies words of the name and folds both halves of the product into one, as wyhash does. A
// name of usual length takes a few cycles. Each table has a random seed, so that nobody can prepare
// names that all fall into one slot.
//
// Thread safety: constant once constructed.
#pragma once

#include <cstdint>
#include <cstring>
#include <random>
#include <string_view>

#include "compiler.hpp"

namespace ztf {

template <class Word>
ZTF_ALWAYS_INLINE Word word_at(const char* text) noexcept {
  Word word;
  std::memcpy(&word, text, sizeof word);
  return word;
}

// Returns a == b. Names are short: a call of memcmp() would cost a tenth of a commit of 16 links.
ZTF_ALWAYS_INLINE bool same_name(std::string_view a, std::string_view b) noexcept {
  if (a.size() != b.size()) return false;
  const char *p = a.data(), *q = b.data();
  std::size_t left = a.size();
  if (left < 8) {
    for (; left > 0; --left)
      if (*p++ != *q++) return false;
    return true;
  }
  for (; left > 8; p += 8, q += 8, left -= 8)
    if (word_at<std::uint64_t>(p) != word_at<std::uint64_t>(q)) return false;
  // The last word may overlap the one before.
  return word_at<std::uint64_t>(p + left - 8) == word_at<std::uint64_t>(q + left - 8);
}

class NameHash {
 public:
  NameHash() : NameHash(std::random_device()) {}

  // All 64 bits depend on every byte and on the length.
  [[nodiscard]] ZTF_ALWAYS_INLINE std::uint64_t operator()(std::string_view name) const noexcept {
    const char* at = name.data();
    std::size_t left = name.size();
    std::uint64_t hash = seed_ ^ (left * mix_);
    for (; left > 16; at += 16, left -= 16)
      hash = folded(word_at<std::uint64_t>(at) ^ hash, word_at<std::uint64_t>(at + 8) ^ mix_);
    std::uint64_t a = 0, b = 0;  // the rest, read from both ends; they may overlap
    if (left >= 8) {
      a = word_at<std::uint64_t>(at), b = word_at<std::uint64_t>(at + left - 8);
    } else if (left >= 4) {
      a = word_at<std::uint32_t>(at), b = word_at<std::uint32_t>(at + left - 4);
    } else if (left > 0) {
      a = word_at<std::uint8_t>(at);
      b = word_at<std::uint8_t>(at + left / 2) | word_at<std::uint8_t>(at + left - 1) << 8;
    }
    return folded(a ^ hash, b ^ mix_);
  }

 private:
  explicit NameHash(std::random_device&& random)
      : seed_(random64(random)), mix_(random64(random)) {}
  static std::uint64_t random64(std::random_device& random) {
    return std::uint64_t{random()} << 32 | random();
  }
  static std::uint64_t folded(std::uint64_t a, std::uint64_t b) noexcept {
    __extension__ const auto product = static_cast<unsigned __int128>(a) * b;
    return static_cast<std::uint64_t>(product >> 64) ^ static_cast<std::uint64_t>(product);
  }

  std::uint64_t seed_, mix_;
};

}  // namespace ztf
