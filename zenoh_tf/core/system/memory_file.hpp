// Files in memory that processes share. The only calls of the system that just Linux has.
//
// Elsewhere `kCanShare` is false, MemoryFile's constructor throws, and the functions fail.
//
// Thread safety: every function, from any thread; of a MemoryFile, all but the destructor.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ztf {

#if defined(__linux__)
inline constexpr bool kCanShare = true;
#else
inline constexpr bool kCanShare = false;
#endif

// A file without a name, mapped by the process that made it. It can grow, but never shrink; others
// can map it read-only. A forked child does not have the mapping.
class MemoryFile {
 public:
  // A mapping of `bytes`, of which the file has `file_bytes`, and memory for the `first` ones.
  // Throws system_error.
  MemoryFile(std::uint64_t bytes, std::uint64_t file_bytes, std::uint64_t first);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  [[nodiscard]] std::byte* begin() const noexcept { return begin_; }
  // For reading; it belongs to this object.
  [[nodiscard]] int descriptor() const noexcept { return read_only_; }
  // Whether this process made the file, and is not a forked child.
  [[nodiscard]] bool is_own() const noexcept;
  // Takes memory from the host for a part of the file, also behind its end. Returns 0, or why that
  // is impossible (errno).
  [[nodiscard]] int allocate(std::uint64_t from, std::uint64_t to) noexcept;

 private:
  void create(std::uint64_t file_bytes, std::uint64_t first);
  void close() noexcept;

  std::byte* begin_ = nullptr;
  std::uint64_t bytes_;
  int writable_ = -1, read_only_ = -1;
  std::int64_t owner_ = 0;  // a process
};

// Of files that other processes made; errno says why a function fails.
namespace memory_file {

// Whether nobody can make the file shorter.
[[nodiscard]] bool is_sealed(int descriptor) noexcept;
// -1 if it cannot be said.
[[nodiscard]] std::int64_t size(int descriptor) noexcept;
// Reads the word at a distance.
[[nodiscard]] bool read(int descriptor, std::uint64_t distance, std::uint64_t& word) noexcept;
// Maps the file for reading; null if that fails.
[[nodiscard]] const void* map(int descriptor, std::uint64_t bytes) noexcept;
void unmap(const void* begin, std::uint64_t bytes) noexcept;
// Another descriptor of the file; -1 if that fails.
[[nodiscard]] int duplicate(int descriptor) noexcept;
void close(int descriptor) noexcept;

}  // namespace memory_file

}  // namespace ztf
