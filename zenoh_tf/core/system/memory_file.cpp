#include "system/memory_file.hpp"

#include <cerrno>
#include <string>
#include <system_error>

#if defined(__linux__)
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#endif

namespace ztf {

#if defined(__linux__)

// Where the kernel's headers are older than the kernel.
#ifndef F_SEAL_FUTURE_WRITE
#define F_SEAL_FUTURE_WRITE 0x0010
#endif
#ifndef MFD_NOEXEC_SEAL
#define MFD_NOEXEC_SEAL 0x0008U
#endif

namespace {

[[noreturn]] void fail(const char* what) {
  throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

MemoryFile::MemoryFile(std::uint64_t bytes, std::uint64_t file_bytes, std::uint64_t first)
    : bytes_(bytes) {
  try {
    create(file_bytes, first);
  } catch (...) {
    close();
    throw;
  }
}

MemoryFile::~MemoryFile() { close(); }

void MemoryFile::create(std::uint64_t file_bytes, std::uint64_t first) {
  // The second attempt is for kernels before 6.3, which do not know the last flag.
  writable_ = ::memfd_create("zenoh-tf", MFD_CLOEXEC | MFD_ALLOW_SEALING | MFD_NOEXEC_SEAL);
  if (writable_ < 0 && errno == EINVAL)
    writable_ = ::memfd_create("zenoh-tf", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (writable_ < 0) fail("memfd_create");
  const std::string path = "/proc/self/fd/" + std::to_string(writable_);
  read_only_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (read_only_ < 0) fail("cannot open the region for reading");
  if (::ftruncate(writable_, static_cast<off_t>(file_bytes)) != 0) fail("ftruncate");
  if (allocate(0, first) != 0) fail("fallocate");
  void* const mapped = ::mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED, writable_, 0);
  if (mapped == MAP_FAILED) fail("mmap");
  begin_ = static_cast<std::byte*>(mapped);
  owner_ = ::getpid();
  // A forked child would write into this process's tree.
  if (::madvise(begin_, bytes_, MADV_DONTFORK) != 0) fail("madvise");
  // After the mapping, through which this process may still write; nobody can make another one.
  if (::fcntl(writable_, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) != 0)
    fail("F_ADD_SEALS");
  if (::fchmod(writable_, 0400) != 0) fail("fchmod");
}

void MemoryFile::close() noexcept {
  if (begin_ && is_own()) ::munmap(begin_, bytes_);
  for (const int descriptor : {writable_, read_only_})
    if (descriptor >= 0) ::close(descriptor);
}

bool MemoryFile::is_own() const noexcept { return owner_ == ::getpid(); }

int MemoryFile::allocate(std::uint64_t from, std::uint64_t to) noexcept {
  const auto begin = static_cast<off_t>(from), bytes = static_cast<off_t>(to - from);
  while (::fallocate(writable_, 0, begin, bytes) != 0)
    if (errno != EINTR) return errno;
  return 0;
}

namespace memory_file {

bool is_sealed(int descriptor) noexcept {
  const int seals = ::fcntl(descriptor, F_GET_SEALS);
  return seals >= 0 && (seals & F_SEAL_SHRINK) != 0;
}
std::int64_t size(int descriptor) noexcept {
  struct stat status{};
  return ::fstat(descriptor, &status) == 0 ? std::int64_t{status.st_size} : -1;
}
bool read(int descriptor, std::uint64_t distance, std::uint64_t& word) noexcept {
  return ::pread(descriptor, &word, sizeof word, static_cast<off_t>(distance)) == sizeof word;
}
const void* map(int descriptor, std::uint64_t bytes) noexcept {
  void* const mapped = ::mmap(nullptr, bytes, PROT_READ, MAP_SHARED, descriptor, 0);
  return mapped == MAP_FAILED ? nullptr : mapped;
}
void unmap(const void* begin, std::uint64_t bytes) noexcept {
  ::munmap(const_cast<void*>(begin), bytes);
}
int duplicate(int descriptor) noexcept { return ::fcntl(descriptor, F_DUPFD_CLOEXEC, 0); }
void close(int descriptor) noexcept { ::close(descriptor); }

}  // namespace memory_file

#else

MemoryFile::MemoryFile(std::uint64_t bytes, std::uint64_t, std::uint64_t) : bytes_(bytes) {
  throw std::system_error(std::make_error_code(std::errc::function_not_supported),
                          "a tree can be shared only on Linux");
}
MemoryFile::~MemoryFile() = default;
bool MemoryFile::is_own() const noexcept { return false; }
int MemoryFile::allocate(std::uint64_t, std::uint64_t) noexcept { return ENOSYS; }

namespace memory_file {

bool is_sealed(int) noexcept { return false; }
std::int64_t size(int) noexcept { return -1; }
bool read(int, std::uint64_t, std::uint64_t&) noexcept { return false; }
const void* map(int, std::uint64_t) noexcept { return nullptr; }
void unmap(const void*, std::uint64_t) noexcept {}
int duplicate(int) noexcept { return -1; }
void close(int) noexcept {}

}  // namespace memory_file

#endif

}  // namespace ztf
