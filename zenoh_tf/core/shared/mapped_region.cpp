// Mapping a region of another process, and refusing what this process cannot read.
#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <limits>

#include "shared/shared_tree.hpp"
#include "system/host.hpp"
#include "system/memory_file.hpp"

namespace ztf {

MappedRegion::MappedRegion(int descriptor) {
  if (!kCanShare) throw RegionRefused("a region can be mapped only on Linux");
  // A mapping whose file shrinks ends the process that touches it.
  if (!memory_file::is_sealed(descriptor))
    throw RegionRefused("the file is not sealed against shrinking");
  const std::int64_t size = memory_file::size(descriptor);
  if (size < std::int64_t{kHeaderBytes}) throw RegionRefused("the file is too small for a region");
  file_bytes_ = static_cast<std::uint64_t>(size);
  map(descriptor);
  try {
    check_header();
    const int own = memory_file::duplicate(descriptor);
    if (own < 0)
      throw RegionRefused(std::string("no file descriptor is left for the region: ") +
                          std::strerror(errno));
    file_.emplace(own, file_bytes_);
  } catch (...) {
    unmap();
    throw;
  }
}

// Maps what the header says, or all of the file if that is more.
void MappedRegion::map(int descriptor) {
  std::uint64_t bytes = 0;
  if (!memory_file::read(descriptor, offsetof(RegionHeader, bytes), bytes))
    throw RegionRefused(std::string("the file cannot be read: ") + std::strerror(errno));
  bytes_ = std::max(bytes, file_bytes_);
  header_ = static_cast<const RegionHeader*>(memory_file::map(descriptor, bytes_));
  if (!header_)
    throw RegionRefused("the region of " + std::to_string(bytes_) +
                        " bytes cannot be mapped: " + std::strerror(errno));
}

void MappedRegion::unmap() noexcept {
  if (header_) memory_file::unmap(header_, bytes_);
}

MappedRegion::~MappedRegion() { unmap(); }

MappedFile::~MappedFile() { memory_file::close(descriptor_); }

std::uint64_t MappedFile::reach_now(std::uint64_t end) const noexcept {
  if (const std::int64_t found = memory_file::size(descriptor_); found >= 0) {
    const auto size = static_cast<std::uint64_t>(found);
    std::uint64_t known = size_.load(std::memory_order_relaxed);
    while (known < size && !size_.compare_exchange_weak(known, size, std::memory_order_release,
                                                        std::memory_order_relaxed)) {
    }
  }
  return std::min(end, size_.load(std::memory_order_acquire));
}

namespace {

// Reads a word of the header once: the owner could change it between a check and its use, and a
// plain load may be repeated.
template <class T>
T read_once(const T& word) noexcept {
  return __atomic_load_n(&word, __ATOMIC_RELAXED);
}

}  // namespace

void MappedRegion::check_header() {
  const RegionHeader& header = *header_;
  if (header.magic != kMagic) throw RegionRefused("the file is not a region of zenoh-tf");
  if (header.layout_version != kLayoutVersion || header.layout_hash != kLayoutHash) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "the region has layout %llu (%016llx), and this process reads layout %llu "
                  "(%016llx)",
                  static_cast<unsigned long long>(header.layout_version),
                  static_cast<unsigned long long>(header.layout_hash),
                  static_cast<unsigned long long>(kLayoutVersion),
                  static_cast<unsigned long long>(kLayoutHash));
    throw RegionRefused(text);
  }
  if (header.bytes != bytes_) throw RegionRefused("the region has not the size that it says");
  const auto text_of = [](const auto& field) {
    return std::string(field, ::strnlen(field, sizeof field));
  };
  if (text_of(header.boot_id) != boot_id())
    throw RegionRefused("the region is of another boot of the host, or of another host");
  if (header.time_namespace != time_namespace())
    throw RegionRefused("the region's owner has another monotonic clock (time namespace)");
  const std::uint32_t concurrency = read_once(header.concurrency);
  const std::uint32_t max_authorities = read_once(header.max_authorities);
  options_.cache_ns = read_once(header.cache_ns);
  options_.max_frames = read_once(header.max_frames);
  options_.max_samples_per_frame = read_once(header.max_samples_per_frame);
  options_.max_name_bytes = read_once(header.max_name_bytes);
  options_.max_depth = read_once(header.max_depth);
  options_.instance = text_of(header.instance);
  if (max_authorities > std::numeric_limits<std::uint16_t>::max() ||
      options_.max_frames > 1u << 30 || options_.max_depth > 1u << 30 ||
      options_.max_name_bytes > 1u << 16 || concurrency > 2)
    throw RegionRefused("the region's limits are out of range");
  options_.concurrency = static_cast<Concurrency>(concurrency);
  options_.max_authorities = static_cast<std::uint16_t>(max_authorities);
}

void MappedRegion::check_array(std::uint64_t distance, std::uint64_t bytes,
                               std::uint64_t alignment) const {
  if (distance % alignment != 0 || distance > file_bytes_ || bytes > file_bytes_ - distance)
    throw RegionRefused("the region's parts lie outside of it");
}

}  // namespace ztf
