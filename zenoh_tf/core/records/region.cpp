// The region's arrays, its header, and its file.
#include "records/region.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <new>
#include <system_error>

#include "base/host.hpp"
#include "base/long_wait.hpp"
#include "base/rejected.hpp"
#include "records/layout.hpp"

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

constexpr std::uint64_t kPage = 4096;
// The file grows by this. To clear so many pages takes the host some 0.2 ms.
constexpr std::uint64_t kStep = std::uint64_t{1} << 20;
// Frames whose records get their memory at once.
constexpr std::uint32_t kRecords = 1024;

// The header and the arrays, with the gaps that align them.
std::uint64_t array_bytes(const Options& options) {
  const std::uint64_t frames = std::uint64_t{options.max_ids()} + 1;
  const std::uint64_t authorities = std::uint64_t{options.max_authorities} + 1;
  const std::uint64_t gaps = 4 * 128;
  return round_up(kHeaderBytes + gaps +
                      frames * (sizeof(Frame) + sizeof(FrameEvents) + sizeof(NameEntry)) +
                      authorities * sizeof(NameEntry),
                  kPage);
}

// More than the tree can ever use: these are addresses, and no memory. Rings waste the ends of
// their blocks, hash tables double, and texts of names are rounded up and kept by size.
std::uint64_t region_bytes(const Options& options) {
  const std::uint64_t names = std::uint64_t{options.max_ids()} + options.max_authorities + 2;
  const std::uint64_t tables = names * 16 * sizeof(NameWord);
  const std::uint64_t texts = names * 4 * options.max_name_bytes;
  const auto memory = static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) *
                      static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  const std::uint64_t rings = options.max_memory_bytes != 0 ? options.max_memory_bytes : memory;
  return round_up(array_bytes(options) + tables + texts + 2 * rings + (std::uint64_t{1} << 26),
                  kStep);
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

Region::Region(const Options& options) : max_ids_(options.max_ids()) {
  try {
    if (options.shared) {
      map_region(region_bytes(options), array_bytes(options));
      header_ = reinterpret_cast<RegionHeader*>(region_);
      header_->used.store(kHeaderBytes, std::memory_order_release);
    } else {
      header_ = make_array<RegionHeader>(1);
    }
    frames_ = make_array<Frame>(std::size_t{options.max_ids()} + 1);
    events_ = make_array<FrameEvents>(std::size_t{options.max_ids()} + 1);
    names_ = make_array<NameEntry>(std::size_t{options.max_ids()} + 1);
    authorities_ = make_array<NameEntry>(std::size_t{options.max_authorities} + 1);
    if (region_) {
      fill_header(options);
      allocate_first_pages();
    }
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
      std::max<std::uint64_t>(least, std::min({round_up(wanted, sizeof(Block)), left, kStep}));
  if (used + bytes > file_bytes_) {
    const std::uint64_t end = std::min(round_up(used + bytes, kStep), bytes_);
    allocate_pages(file_bytes_, end);
    file_bytes_ = end;
  }
  // Before anyone can find a record in it, and after the file has got it: readers accept nothing
  // beyond it, and what they accept is in the file.
  header_->used.store(used + bytes, std::memory_order_release);
  return {region_ + used, bytes};
}

void Region::allocate_records(std::uint32_t last_id) {
  if (!region_ || last_id <= last_record_) return;
  const std::uint32_t last = std::min(max_ids_, std::max(last_id, last_record_ + kRecords));
  const auto allocate = [&]<class T>(const T* array) {
    const auto begin =
        static_cast<std::uint64_t>(reinterpret_cast<const std::byte*>(array) - region_);
    allocate_pages((begin + last_record_ * sizeof(T)) / kPage * kPage,
                   round_up(begin + (last + std::uint64_t{1}) * sizeof(T), kPage));
  };
  allocate(frames_);
  allocate(events_);
  allocate(names_);
  last_record_ = last;
}

#if defined(__linux__)

void Region::map_region(std::uint64_t bytes, std::uint64_t file_bytes) {
  // The second attempt is for kernels before 6.3, which do not know the last flag.
  writable_ = ::memfd_create("zenoh-tf", MFD_CLOEXEC | MFD_ALLOW_SEALING | MFD_NOEXEC_SEAL);
  if (writable_ < 0 && errno == EINVAL)
    writable_ = ::memfd_create("zenoh-tf", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (writable_ < 0) fail("memfd_create");
  const std::string path = "/proc/self/fd/" + std::to_string(writable_);
  read_only_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (read_only_ < 0) fail("cannot open the region for reading");
  if (::ftruncate(writable_, static_cast<off_t>(file_bytes)) != 0) fail("ftruncate");
  if (try_allocate(0, kHeaderBytes) != 0) fail("fallocate");
  void* const mapped = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, writable_, 0);
  if (mapped == MAP_FAILED) fail("mmap");
  region_ = static_cast<std::byte*>(mapped);
  bytes_ = bytes;
  file_bytes_ = file_bytes;
  owner_ = ::getpid();
  // A forked child would write into this process's tree.
  if (::madvise(region_, bytes, MADV_DONTFORK) != 0) fail("madvise");
  // After the mapping, through which this process may still write; nobody can make another one.
  if (::fcntl(writable_, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) != 0)
    fail("F_ADD_SEALS");
  if (::fchmod(writable_, 0400) != 0) fail("fchmod");
}

int Region::try_allocate(std::uint64_t begin, std::uint64_t end) noexcept {
  const auto from = static_cast<off_t>(begin), bytes = static_cast<off_t>(end - begin);
  while (::fallocate(writable_, 0, from, bytes) != 0)
    if (errno != EINTR) return errno;
  return 0;
}

void Region::unmap_region() noexcept {
  if (region_ && owner_ == ::getpid()) {
    // Readers that have mapped the region keep its memory, and must not trust it any more.
    if (header_) header_->lease_ns.store(0, std::memory_order_seq_cst);
    ::munmap(region_, bytes_);
  }
  for (const int descriptor : {writable_, read_only_})
    if (descriptor >= 0) ::close(descriptor);
}

#else

void Region::map_region(std::uint64_t, std::uint64_t) {
  throw std::system_error(std::make_error_code(std::errc::function_not_supported),
                          "a tree can be shared only on Linux");
}
int Region::try_allocate(std::uint64_t, std::uint64_t) noexcept { return 0; }
void Region::unmap_region() noexcept {}

#endif

void Region::allocate_pages(std::uint64_t begin, std::uint64_t end) {
  const int error = try_allocate(begin, end);
  if (error == 0) return;
  const std::string bytes = std::to_string(end - begin);
  throw Rejected{.code = Code::limit,
                 .message = "the host has no " + bytes +
                            " bytes of memory left for the shared tree (" + std::strerror(error) +
                            "): free memory there",
                 .field = "host_memory",
                 .value = static_cast<std::int64_t>(end - begin)};
}

void Region::allocate_first_pages() {
  const auto distance = [&](const void* to) {
    return static_cast<std::uint64_t>(static_cast<const std::byte*>(to) - region_);
  };
  // The authorities are the last array, and the arena follows.
  const std::uint64_t end = round_up(file_bytes_, kStep);
  if (const int error = try_allocate(distance(authorities_) / kPage * kPage, end))
    throw std::system_error(error, std::generic_category(), "fallocate");
  file_bytes_ = end;
}

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
