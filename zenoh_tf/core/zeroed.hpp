// An array of zeroed records that costs nothing until it is touched.
//
// Thread safety: as its records.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

namespace ztf {

// T must be good when all its bytes are zero, and need no destruction here.
template <class T>
class ZeroedArray {
 public:
  explicit ZeroedArray(std::size_t size) : memory_(std::calloc(1, size * sizeof(T) + alignof(T))) {
    if (!memory_) throw std::bad_alloc();
    const auto address = reinterpret_cast<std::uintptr_t>(memory_.get());
    first_ = reinterpret_cast<T*>((address + alignof(T) - 1) & ~(alignof(T) - 1));
  }
  [[nodiscard]] T* begin() const noexcept { return first_; }
  T& operator[](std::size_t i) const noexcept { return first_[i]; }

 private:
  struct Free {
    void operator()(void* memory) const noexcept { std::free(memory); }
  };
  std::unique_ptr<void, Free> memory_;
  T* first_;
};

}  // namespace ztf
