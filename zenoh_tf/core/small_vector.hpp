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
  SmallVector() noexcept : data_(inline_data()) {}
  SmallVector(const SmallVector&) = delete;
  SmallVector& operator=(const SmallVector&) = delete;

  void push_back(const T& value) {
    if (size_ == capacity_) {
      const T copy = value;  // `value` may live in the storage that grow() frees
      grow();
      data_[size_++] = copy;
    } else {
      data_[size_++] = value;
    }
  }
  // Room for `extra` more, to be written through data() and counted by set_size().
  [[nodiscard]] T* reserve(std::size_t extra) {
    while (size_ + extra > capacity_) [[unlikely]]
      grow();
    return data_;
  }
  void set_size(std::size_t size) noexcept { size_ = size; }
  void clear() noexcept { size_ = 0; }

  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  [[nodiscard]] T& operator[](std::size_t i) noexcept { return data_[i]; }
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept { return data_[i]; }
  [[nodiscard]] T& back() noexcept { return data_[size_ - 1]; }
  [[nodiscard]] const T& back() const noexcept { return data_[size_ - 1]; }
  [[nodiscard]] T* begin() noexcept { return data_; }
  [[nodiscard]] T* end() noexcept { return data_ + size_; }
  [[nodiscard]] const T* begin() const noexcept { return data_; }
  [[nodiscard]] const T* end() const noexcept { return data_ + size_; }

 private:
  T* inline_data() noexcept { return reinterpret_cast<T*>(inline_); }
  void grow() {
    const std::size_t capacity = capacity_ * 2;
    std::unique_ptr<T[]> bigger(new T[capacity]);
    std::memcpy(static_cast<void*>(bigger.get()), data_, size_ * sizeof(T));
    heap_ = std::move(bigger);
    data_ = heap_.get();
    capacity_ = capacity;
  }

  T* data_;
  std::size_t size_ = 0;
  std::size_t capacity_ = N;
  std::unique_ptr<T[]> heap_;
  alignas(T) std::byte inline_[N * sizeof(T)];
};

}  // namespace ztf
