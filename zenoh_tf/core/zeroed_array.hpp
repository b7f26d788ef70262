// An array of zeroed records, whose pages take no memory until they are touched.
//
// Thread safety: that of its records. The array itself never changes.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace ztf {

// Requires that zeroed bytes are a valid T. Never calls a constructor or a destructor of T.
template <class T>
class ZeroedArray {
 public:
  explicit ZeroedArray(std::size_t size) : memory_(std::calloc(1, size * sizeof(T) + alignof(T))) {
    if (!memory_) throw std::bad_alloc();
    const auto address = reinterpret_cast<std::uintptr_t>(memory_.get());
    first_ = reinterpret_cast<T*>(aligned(address, alignof(T)));
#if defined(__linux__)
    // Asks for huge pages, but not for the beginning, which is all that a small tree touches.
    const std::uintptr_t large = aligned(address + kHugePage, kHugePage);
    const std::uintptr_t end = address + size * sizeof(T);
    if (large < end) (void)::madvise(reinterpret_cast<void*>(large), end - large, MADV_HUGEPAGE);
#endif
  }
  [[nodiscard]] T* begin() const noexcept { return first_; }
  T& operator[](std::size_t i) const noexcept { return first_[i]; }

 private:
  static constexpr std::uintptr_t kHugePage = std::uintptr_t{1} << 21;
  static std::uintptr_t aligned(std::uintptr_t address, std::uintptr_t to) noexcept {
    return (address + to - 1) & ~(to - 1);
  }
  struct Free {
    void operator()(void* memory) const noexcept { std::free(memory); }
  };
  std::unique_ptr<void, Free> memory_;
  T* first_;
};

}  // namespace ztf
