// How a process reads a tree of another one: without trust in what it finds, and without waiting
// for long.
//
// The owner may die, stop or be damaged at any instant. So ids and distances are checked before
// they are followed, and all waiting and repeating has an end. What these checks refuse was never
// stored by a correct owner.
//
// Thread safety: constant, but for Attempt and Patience, which live on one reader's stack.
#pragma once

#include "reads/guards.hpp"
#include "records/frame_access.hpp"
#include "records/layout.hpp"

namespace ztf {

// Thrown if a shared tree cannot answer: then its owner can.
struct Unanswered {
  enum class Reason : std::uint8_t {
    busy,        // writers changed what was read again and again, or one stopped while it wrote
    lapsed,      // the owner has not extended its lease: it has ended, or stopped
    waiting,     // the answer is not there yet, and the caller wants to wait for it
    unreadable,  // the region's content is corrupt
    absent,      // no tree is mapped; for callers, as a tree never throws it
  };
  Reason reason;
};

// How far the file of a mapped region reaches.
//
// The mapping is longer than the file, which grows: to touch a page behind its end would end the
// process (SIGBUS), while a page within it can be read from the moment on at which the file has it,
// through the same mapping. So readers touch only what lies before a size that the system has
// reported, and never rely on the header for that. The file is sealed against shrinking, so a size
// that was reported once holds for the mapping's life, for all threads and whenever they use it.
// The owner lets the file grow before it moves RegionHeader::used ahead. So if that lies beyond the
// size known here, it is enough to ask the system again; if it is still beyond, the header is
// wrong.
class MappedFile {
 public:
  // Keeps a descriptor of its own, which it closes.
  MappedFile(int descriptor, std::uint64_t size) noexcept : descriptor_(descriptor), size_(size) {}
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  // Returns `end`, or the file's size if that is less.
  [[nodiscard]] std::uint64_t reach(std::uint64_t end) const noexcept {
    return end <= size_.load(std::memory_order_acquire) ? end : reach_now(end);
  }

 private:
  [[nodiscard, gnu::noinline, gnu::cold]] std::uint64_t reach_now(std::uint64_t end) const noexcept;

  const int descriptor_;
  mutable std::atomic<std::uint64_t> size_;
};

// The mapped region, as it is checked against.
class MappedMemory {
 public:
  MappedMemory(const RegionHeader& header, const MappedFile& file,
               std::uint32_t longest_name) noexcept
      : header_(header), file_(file), longest_name_(longest_name) {}

  // Whether these bytes lie in the used part, and begin at a whole word.
  [[nodiscard]] bool holds(const void* begin, std::size_t bytes) const noexcept {
    const std::uint64_t from = distance(begin), end = used();
    return from % sizeof(std::uint64_t) == 0 && from <= end && bytes <= end - from;
  }
  static constexpr bool may_retry(int retries) noexcept { return retries < 1000; }
  [[nodiscard]] std::size_t longest_name() const noexcept { return longest_name_; }

  [[nodiscard]] std::uint64_t distance(const void* to) const noexcept {
    return reinterpret_cast<std::uintptr_t>(to) - reinterpret_cast<std::uintptr_t>(&header_);
  }
  [[nodiscard]] std::uint64_t used() const noexcept {
    return file_.reach(header_.used.load(std::memory_order_acquire));
  }

 private:
  const RegionHeader& header_;
  const MappedFile& file_;
  const std::uint32_t longest_name_;
};

// What one attempt to read checks against. The bounds are loaded once, and again only when
// something lies beyond them: the owner moves them before it stores what does.
struct Attempt {
  Attempt(const MappedMemory& mapped, const NameReader<MappedMemory>& names) noexcept
      : memory(mapped), frame_names(names), used(mapped.used()), last_frame(names.size()) {}

  const MappedMemory& memory;
  const NameReader<MappedMemory>& frame_names;
  std::uint64_t used;
  FrameId last_frame;
  bool is_unreadable = false;
};

// FrameAccess with bounds. What is out of bounds is replaced by something harmless, and the attempt
// is marked: its result is unspecified.
class MappedFrames {
 public:
  MappedFrames(const Frame* frames, Attempt& attempt) noexcept
      : frames_(frames), attempt_(attempt) {}

  [[nodiscard]] ZTF_ALWAYS_INLINE const Frame* frame(FrameId id) const noexcept {
    return id <= attempt_.last_frame || exists(id) ? frames_ + id : frames_;
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE Ring ring(const Frame& frame) const noexcept {
    const Ring ring = frame.ring.load(std::memory_order_acquire);
    return is_mapped(ring) || is_mapped_now(ring) ? ring : Ring::without(frame.latest);
  }
  [[nodiscard]] FrameId id_of(const Frame* frame) const noexcept {
    return static_cast<FrameId>(frame - frames_);
  }

 private:
  [[gnu::noinline, gnu::cold]] bool exists(FrameId id) const noexcept {
    attempt_.last_frame = attempt_.frame_names.size();
    attempt_.is_unreadable |= id > attempt_.last_frame;
    return id <= attempt_.last_frame;
  }
  [[nodiscard]] ZTF_ALWAYS_INLINE bool is_mapped(Ring ring) const noexcept {
    const std::uint64_t from = attempt_.memory.distance(ring.begin());
    return ring.has_valid_capacity() && from <= attempt_.used &&
           ring.bytes() <= attempt_.used - from;
  }
  [[gnu::noinline, gnu::cold]] bool is_mapped_now(Ring ring) const noexcept {
    attempt_.used = attempt_.memory.used();
    const bool mapped = is_mapped(ring);
    attempt_.is_unreadable |= !mapped;
    return mapped;
  }

  const Frame* const frames_;
  Attempt& attempt_;
};

// How long one read may wait for writers: about half a millisecond of naps, several times what a
// query of the server takes.
class Patience {
 public:
  // Waits for a moment. Returns false, without waiting, once all is used up.
  bool wait() {
    if (backoff_.spin()) return true;
    if (naps_ == kNaps) return false;
    ++naps_;
    backoff_.nap();
    return true;
  }
  [[nodiscard]] bool is_exhausted() const noexcept { return naps_ == kNaps; }

 private:
  static constexpr int kNaps = 8;
  Backoff backoff_;
  int naps_ = 0;
};

// WalkGuard and OptimisticGuard, with waiting that ends.
class PatientWalkGuard : public WalkGuard {
 public:
  explicit PatientWalkGuard(Patience& patience) noexcept : patience_(patience) {}
  ZTF_ALWAYS_INLINE bool read_version(const Frame& frame, Version& version) const {
    version = frame.version.read_begin([this] { return patience_.wait(); });
    return true;
  }

 private:
  Patience& patience_;
};
class PatientGuard : public OptimisticGuard {
 public:
  PatientGuard(const Frame* frames, ReadSet& reads, Patience& patience) noexcept
      : OptimisticGuard(frames, reads), patience_(patience) {}
  bool read_version(const Frame& frame, Version& version) const {
    version = frame.version.read_begin([this] { return patience_.wait(); });
    return true;
  }

 private:
  Patience& patience_;
};

}  // namespace ztf
