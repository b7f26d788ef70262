// A seeded hash of names.
//
// It multiplies words of the name and folds both halves of the product into one, as wyhash does.
// The last product is multiplied once more: else one seed in a hundred gives numbered names, such
// as link_0 to link_999, three times as many collisions, and one in a thousand a hundred times. A
// name of usual length takes a few cycles. Each table has a random seed, so that nobody can prepare
// names that all fall into one slot.
//
// Thread safety: constant once constructed.
#pragma once

#include <cstdint>
#include <cstring>
#include <random>
#include <string_view>

#include "base/compiler.hpp"

namespace ztf {

template <class Word>
ZTF_ALWAYS_INLINE Word word_at(const char* text) noexcept {
  Word word;
  std::memcpy(&word, text, sizeof word);
  return word;
}

class NameHash {
 public:
  NameHash() : NameHash(std::random_device()) {}
  NameHash(std::uint64_t seed, std::uint64_t mix) noexcept : seed_(seed), mix_(mix) {}

  [[nodiscard]] std::uint64_t seed() const noexcept { return seed_; }
  [[nodiscard]] std::uint64_t mix() const noexcept { return mix_; }

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
    const Product last = product(a ^ hash, b ^ mix_);
    return folded(static_cast<std::uint64_t>(last) ^ seed_,
                  static_cast<std::uint64_t>(last >> 64) ^ mix_);
  }

 private:
  explicit NameHash(std::random_device&& random)
      : seed_(random64(random)), mix_(random64(random)) {}
  static std::uint64_t random64(std::random_device& random) {
    return std::uint64_t{random()} << 32 | random();
  }
  __extension__ using Product = unsigned __int128;
  static Product product(std::uint64_t a, std::uint64_t b) noexcept { return Product{a} * b; }
  static std::uint64_t folded(std::uint64_t a, std::uint64_t b) noexcept {
    const Product both = product(a, b);
    return static_cast<std::uint64_t>(both >> 64) ^ static_cast<std::uint64_t>(both);
  }

  std::uint64_t seed_, mix_;
};

}  // namespace ztf
