// The region's arrays and its header. For its file see system/memory_file.hpp.
#include "records/region.hpp"

#include <algorithm>
#include <cstring>
#include <new>
#include <system_error>

#include "base/long_wait.hpp"
#include "base/rejected.hpp"
#include "records/layout.hpp"
#include "system/host.hpp"

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
  const std::uint64_t rings =
      options.max_memory_bytes != 0 ? options.max_memory_bytes : physical_memory_bytes();
  return round_up(array_bytes(options) + tables + texts + 2 * rings + (std::uint64_t{1} << 26),
                  kStep);
}

}  // namespace

template <class T>
T* Region::make_array(std::size_t size) {
  const std::size_t bytes = size * sizeof(T);
  return reinterpret_cast<T*>(allocate(bytes, bytes).begin);
}

Region::Region(const Options& options) : max_ids_(options.max_ids()) {
  if (options.shared) {
    bytes_ = region_bytes(options);
    file_bytes_ = array_bytes(options);
    region_ = file_.emplace(bytes_, file_bytes_, kHeaderBytes).begin();
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
}

Region::~Region() {
  // Readers that have mapped the region keep its memory, and must not trust it any more.
  if (file_ && file_->is_own()) header_->lease_ns.store(0, std::memory_order_seq_cst);
}

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

void Region::allocate_pages(std::uint64_t begin, std::uint64_t end) {
  const int error = file_->allocate(begin, end);
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
  if (const int error = file_->allocate(distance(authorities_) / kPage * kPage, end))
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
