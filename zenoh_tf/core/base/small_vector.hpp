// A vector of trivially copyable values whose first N live inside it. Lookups and commits keep
// their working sets in such vectors, so that the usual sizes allocate nothing.
//
// Thread safety: none; lives on one thread's stack.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <new>
#include <type_traits>

namespace ztf {

template <class T, std::size_t N>
class SmallVector {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  SmallVector() noexcept {}
  SmallVector(const SmallVector&) = delete;
  SmallVector& operator=(const SmallVector&) = delete;

  ~SmallVector() { release(); }

  void push_back(const T& value) {
    const T copy = value;  // `value` may live in the storage that grow() frees
    *append(1) = copy;
  }
  // Makes room for `extra` more values, and returns the first value: push_back() cannot fail then.
  // Throws bad_alloc.
  [[nodiscard]] T* reserve(std::size_t extra) {
    while (size_ + extra > capacity_) [[unlikely]]
      grow();
    return begin_;
  }
  // Adds `n` uninitialised values, and returns the first of them. Throws bad_alloc.
  [[nodiscard]] T* append(std::size_t n) {
    T* const first = reserve(n) + size_;
    size_ += static_cast<std::uint32_t>(n);
    return first;
  }
  void set_size(std::size_t size) noexcept { size_ = static_cast<std::uint32_t>(size); }
  void clear() noexcept { size_ = 0; }

  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] T* begin() noexcept { return begin_; }
  [[nodiscard]] const T* begin() const noexcept { return begin_; }
  [[nodiscard]] T* end() noexcept { return begin_ + size_; }
  [[nodiscard]] const T* end() const noexcept { return begin_ + size_; }
  [[nodiscard]] T& operator[](std::size_t i) noexcept { return begin_[i]; }
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept { return begin_[i]; }
  [[nodiscard]] T& back() noexcept { return begin_[size_ - 1]; }

 private:
  [[gnu::noinline]] void grow() {
    if (capacity_ > kMaxCapacity / 2) throw std::bad_alloc();
    T* const bigger = new T[std::size_t{capacity_} * 2];
    std::memcpy(static_cast<void*>(bigger), begin_, size_ * sizeof(T));
    release();
    begin_ = bigger;
    capacity_ *= 2;
  }
  void release() noexcept {
    if (begin_ != reinterpret_cast<T*>(inline_)) [[unlikely]]
      delete[] begin_;
  }

  static constexpr std::uint32_t kMaxCapacity = std::numeric_limits<std::uint32_t>::max();

  // Only these words are initialised: lookups and commits make several vectors each.
  T* begin_ = reinterpret_cast<T*>(inline_);
  std::uint32_t size_ = 0;
  std::uint32_t capacity_ = N;
  alignas(T) std::byte inline_[N * sizeof(T)];  // not initialised
};

}  // namespace ztf
