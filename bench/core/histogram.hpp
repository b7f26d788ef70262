// Durations in buckets of equal relative width: any percentile, to within 1 %.
//
// Thread safety: none; every thread has its own, and they are added up.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace bench {

class Histogram {
 public:
  void add(std::uint64_t ns) noexcept {
    ++buckets_[index(ns)];
    ++size_;
  }
  void add(const Histogram& other) noexcept {
    for (std::size_t i = 0; i < buckets_.size(); ++i) buckets_[i] += other.buckets_[i];
    size_ += other.size_;
  }

  // The middle of the bucket that holds it; NaN where there is nothing.
  [[nodiscard]] double percentile(double percent) const noexcept {
    if (size_ == 0) return std::nan("");
    const auto wanted =
        static_cast<std::uint64_t>(std::ceil(static_cast<double>(size_) * percent / 100));
    std::uint64_t seen = 0;
    std::size_t i = 0;
    while ((seen += buckets_[i]) < wanted) ++i;
    return middle(i);
  }

 private:
  static constexpr int kBits = 6;
  static constexpr std::uint64_t kPart = 1u << kBits;  // buckets of each power of two

  static std::size_t index(std::uint64_t ns) noexcept {
    if (ns < 2 * kPart) return ns;
    const int shift = std::bit_width(ns) - kBits - 1;
    return static_cast<std::size_t>(shift) * kPart + (ns >> shift);
  }
  static double middle(std::size_t i) noexcept {
    if (i < 2 * kPart) return static_cast<double>(i);
    const auto shift = static_cast<int>(i / kPart) - 1;
    return std::ldexp(static_cast<double>(i % kPart + kPart) + 0.5, shift);
  }

  std::array<std::uint64_t, (64 - kBits + 1) * kPart> buckets_{};
  std::uint64_t size_ = 0;
};

}  // namespace bench
