// A vector of trivially copyable values whose first N live inside it.
//
// Thread safety: none; lives on one thread's stack. Lookups and commits keep
// their working sets in it, so that the usual sizes allocate nothing.
#pragma once

#include <cstddef>
#include <cstring>
#include <memory>
#include <type_traits>

namespace ztf {

template <class T, std::size_t N>
class SmallVector {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  SmallVector() noexcept {}
  SmallVector(const SmallVector&) = delete;
  SmallVector& operator=(const SmallVector&) = delete;

  void push_back(const T& value) {
    const T copy = value;  // `value` may live in the storage that grow() frees
    *append(1) = copy;
  }
  // Room for `extra` more, to be written through the result and counted by set_size().
  [[nodiscard]] T* reserve(std::size_t extra) {
    while (size_ + extra > capacity_) [[unlikely]]
      grow();
    return begin();
  }
  // Adds `n` values, to be written through the result.
  [[nodiscard]] T* append(std::size_t n) {
    T* const first = reserve(n) + size_;
    size_ += n;
    return first;
  }
  void set_size(std::size_t size) noexcept { size_ = size; }
  void clear() noexcept { size_ = 0; }

  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] T* begin() noexcept { return heap_ ? heap_.get() : reinterpret_cast<T*>(inline_); }
  [[nodiscard]] const T* begin() const noexcept {
    return heap_ ? heap_.get() : reinterpret_cast<const T*>(inline_);
  }
  [[nodiscard]] T* end() noexcept { return begin() + size_; }
  [[nodiscard]] const T* end() const noexcept { return begin() + size_; }
  [[nodiscard]] T& operator[](std::size_t i) noexcept { return begin()[i]; }
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept { return begin()[i]; }
  [[nodiscard]] T& back() noexcept { return begin()[size_ - 1]; }

 private:
  [[gnu::noinline]] void grow() {
    const std::size_t capacity = capacity_ * 2;
    std::unique_ptr<T[]> bigger(new T[capacity]);
    std::memcpy(static_cast<void*>(bigger.get()), begin(), size_ * sizeof(T));
    heap_ = std::move(bigger);
    capacity_ = capacity;
  }

  std::size_t size_ = 0;
  std::size_t capacity_ = N;
  std::unique_ptr<T[]> heap_;
  alignas(T) std::byte inline_[N * sizeof(T)];  // left alone until it is used
};

}  // namespace ztf
