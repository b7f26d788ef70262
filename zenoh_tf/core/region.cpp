// The region's arrays, its header, and the sealed memfd.
#include "region.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <new>
#include <system_error>

#include "host.hpp"
#include "layout.hpp"
#include "long_wait.hpp"

#if defined(__linux__)
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include <cerrno>
#endif

namespace ztf {

namespace {

constexpr std::uint64_t round_up(std::uint64_t bytes, std::uint64_t to) noexcept {
  return (bytes + to - 1) / to * to;
}

// More than the tree can ever use, as what is not touched costs nothing. Rings waste the ends of
// their blocks, hash tables double, and texts of names are rounded up and kept by size.
std::uint64_t region_bytes(const Options& options) {
  const std::uint64_t frames = std::uint64_t{options.max_ids()} + 1;
  const std::uint64_t authorities = std::uint64_t{options.max_authorities} + 1;
  const std::uint64_t arrays = kHeaderBytes +
                               frames * (sizeof(Frame) + sizeof(FrameEvents) + sizeof(NameEntry)) +
                               authorities * sizeof(NameEntry);
  const std::uint64_t tables = (frames + authorities) * 16 * sizeof(NameWord);
  const std::uint64_t texts = (frames + authorities) * 4 * options.max_name_bytes;
  const auto memory = static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) *
                      static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  const std::uint64_t rings = options.max_memory_bytes != 0 ? options.max_memory_bytes : memory;
  return round_up(arrays + tables + texts + 2 * rings + (std::uint64_t{1} << 26), 1 << 21);
}

#if defined(__linux__)
// Where the kernel's headers are older than the kernel.
#ifndef F_SEAL_FUTURE_WRITE
#define F_SEAL_FUTURE_WRITE 0x0010
#endif
#ifndef MFD_NOEXEC_SEAL
#define MFD_NOEXEC_SEAL 0x0008U
#endif

[[noreturn]] void fail(const char* what) {
  throw std::system_error(errno, std::generic_category(), what);
}
#endif

}  // namespace

template <class T>
T* Region::make_array(std::size_t size) {
  const std::size_t bytes = size * sizeof(T);
  return reinterpret_cast<T*>(allocate(bytes, bytes).begin);
}

Region::Region(const Options& options) {
  try {
    if (options.shared) {
      map_region(region_bytes(options));
      header_ = reinterpret_cast<RegionHeader*>(region_);
      header_->used.store(kHeaderBytes, std::memory_order_release);
    } else {
      header_ = make_array<RegionHeader>(1);
    }
    frames_ = make_array<Frame>(std::size_t{options.max_ids()} + 1);
    events_ = make_array<FrameEvents>(std::size_t{options.max_ids()} + 1);
    names_ = make_array<NameEntry>(std::size_t{options.max_ids()} + 1);
    authorities_ = make_array<NameEntry>(std::size_t{options.max_authorities} + 1);
    if (region_) fill_header(options);
  } catch (...) {
    unmap_region();
    throw;
  }
}

Region::~Region() { unmap_region(); }

Region::Piece Region::allocate(std::size_t least, std::size_t wanted) {
  const auto lock = lock_announced(mutex_);
  if (!region_) {
    const std::size_t blocks = (wanted + sizeof(Block) - 1) / sizeof(Block);
    blocks_.emplace_back(blocks);
    return {blocks_.back().begin()->bytes, blocks * sizeof(Block)};
  }
  // Only this function changes it, under the mutex.
  const std::uint64_t used = header_->used.load(std::memory_order_relaxed);
  const std::uint64_t left = bytes_ - used;
  least = round_up(least, sizeof(Block));
  if (least > left) throw std::bad_alloc();
  const std::uint64_t bytes =
      std::max<std::uint64_t>(least, std::min(round_up(wanted, sizeof(Block)), left));
  // Before anyone can find a record in it: readers accept nothing beyond it.
  header_->used.store(used + bytes, std::memory_order_release);
  return {region_ + used, bytes};
}

#if defined(__linux__)

void Region::map_region(std::uint64_t bytes) {
  // The second attempt is for kernels before 6.3, which do not know the last flag.
  descriptor_ = ::memfd_create("zenoh-tf", MFD_CLOEXEC | MFD_ALLOW_SEALING | MFD_NOEXEC_SEAL);
  if (descriptor_ < 0 && errno == EINVAL)
    descriptor_ = ::memfd_create("zenoh-tf", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (descriptor_ < 0) fail("memfd_create");
  if (::ftruncate(descriptor_, static_cast<off_t>(bytes)) != 0) fail("ftruncate");
  void* const mapped = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor_, 0);
  if (mapped == MAP_FAILED) fail("mmap");
  region_ = static_cast<std::byte*>(mapped);
  bytes_ = bytes;
  owner_ = ::getpid();
  // A forked child would write into this process's tree.
  if (::madvise(region_, bytes, MADV_DONTFORK) != 0) fail("madvise");
  // After the mapping, through which this process may still write; nobody can make another one.
  if (::fcntl(descriptor_, F_ADD_SEALS,
              F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) != 0)
    fail("F_ADD_SEALS");
  if (::fchmod(descriptor_, 0400) != 0) fail("fchmod");
}

void Region::unmap_region() noexcept {
  if (region_ && owner_ == ::getpid()) {
    // Readers that have mapped the region keep its memory, and must not believe in it any more.
    if (header_) header_->lease_ns.store(0, std::memory_order_seq_cst);
    ::munmap(region_, bytes_);
  }
  if (descriptor_ >= 0) ::close(descriptor_);
}

#else

void Region::map_region(std::uint64_t) {
  throw std::system_error(std::make_error_code(std::errc::function_not_supported),
                          "a tree can be shared only on Linux");
}
void Region::unmap_region() noexcept {}

#endif

void Region::fill_header(const Options& options) {
  RegionHeader& header = *header_;
  const auto distance = [&](const void* to) {
    return static_cast<std::uint64_t>(static_cast<const std::byte*>(to) - region_);
  };
  header.layout_version = kLayoutVersion;
  header.layout_hash = kLayoutHash;
  header.bytes = bytes_;
  header.time_namespace = time_namespace();
  const std::string boot = boot_id();
  std::memcpy(header.boot_id, boot.data(), std::min(boot.size(), sizeof header.boot_id - 1));
  std::memcpy(header.instance, options.instance.data(),
              std::min(options.instance.size(), sizeof header.instance - 1));
  header.cache_ns = options.cache_ns;
  header.concurrency = static_cast<std::uint32_t>(options.concurrency);
  header.max_frames = options.max_frames;
  header.max_authorities = options.max_authorities;
  header.max_samples_per_frame = options.max_samples_per_frame;
  header.max_name_bytes = options.max_name_bytes;
  header.max_depth = options.max_depth;
  header.frames = distance(frames_);
  header.events = distance(events_);
  header.magic = kMagic;
}

}  // namespace ztf
