// An array of zeroed records, whose pages take no memory until they are touched.
//
// Large arrays are mapped, and not taken from the heap. The heap gives a freed block again, which
// it must clear first: then each page of the array takes memory, touched or not.
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
  explicit ZeroedArray(std::size_t size) : memory_(allocate(size * sizeof(T) + alignof(T))) {
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
  // A mapping takes whole pages, and a process may have only so many of them.
  static constexpr std::size_t kLeastMapped = std::size_t{1} << 17;

  static std::uintptr_t aligned(std::uintptr_t address, std::uintptr_t to) noexcept {
    return (address + to - 1) & ~(to - 1);
  }
  struct Free {
    std::size_t mapped = 0;  // bytes; 0: it is from the heap
    void operator()(void* memory) const noexcept {
#if defined(__linux__)
      if (mapped != 0) return (void)::munmap(memory, mapped);
#endif
      std::free(memory);
    }
  };
  using Memory = std::unique_ptr<void, Free>;

  static Memory allocate(std::size_t bytes) {
#if defined(__linux__)
    if (bytes >= kLeastMapped) {
      void* const mapped =
          ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
      if (mapped == MAP_FAILED) throw std::bad_alloc();
      return Memory(mapped, Free{bytes});
    }
#endif
    Memory memory(std::calloc(1, bytes));
    if (!memory) throw std::bad_alloc();
    return memory;
  }

  Memory memory_;
  T* first_;
};

}  // namespace ztf
