// The folder `shared/`: the tree of another process of this host, valid for a lease.
// In: a descriptor of the owner's memory, and queries. Out: answers, or why there is none.
// It may include base, records, reads, estimates, tree_state.hpp.
//
// A tree of another process on this host, mapped read-only: its lookups, as the owner answers them.
//
// Every read is validated as an optimistic read of the owner is, whatever the owner's concurrency
// control: all of them change versions alike (commits/write_locks.hpp). Then the lease is checked,
// so that no answer comes from a tree whose successor may have changed
// (docs/explanation/concurrency.md). A read never takes a lock, never writes, and ends: if it finds
// no valid answer, it throws Unanswered.
//
// Thread safety: every function, from any thread.
#pragma once

#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "base/options.hpp"
#include "estimates/cache.hpp"
#include "estimates/estimate.hpp"
#include "estimates/limits.hpp"
#include "reads/query.hpp"
#include "reads/velocity.hpp"
#include "shared/mapped_memory.hpp"

namespace ztf {

// Thrown if a file descriptor is not that of a region that this process can read.
struct RegionRefused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A region of another process, mapped read-only and checked.
class MappedRegion {
 public:
  // Keeps a copy of the descriptor. Throws RegionRefused and bad_alloc.
  explicit MappedRegion(int descriptor);
  ~MappedRegion();
  MappedRegion(const MappedRegion&) = delete;
  MappedRegion& operator=(const MappedRegion&) = delete;

  [[nodiscard]] const RegionHeader& header() const noexcept { return *header_; }
  [[nodiscard]] const MappedFile& file() const noexcept { return *file_; }
  // Copied when the region was mapped, like all that is not checked again.
  [[nodiscard]] const Options& options() const noexcept { return options_; }
  // Returns the records at a distance from the header. Throws RegionRefused if they are not all
  // in the region.
  template <class T>
  [[nodiscard]] const T* array(std::uint64_t distance, std::uint64_t size) const {
    check_array(distance, size * sizeof(T), alignof(T));
    return reinterpret_cast<const T*>(reinterpret_cast<std::uintptr_t>(header_) + distance);
  }

 private:
  void map(int descriptor);
  void check_header();
  void check_array(std::uint64_t distance, std::uint64_t bytes, std::uint64_t alignment) const;
  void unmap() noexcept;

  const RegionHeader* header_ = nullptr;
  std::uint64_t bytes_ = 0;       // of the mapping: the most that the file may have
  std::uint64_t file_bytes_ = 0;  // of the file, when it was mapped
  std::optional<MappedFile> file_;
  Options options_;
};

class Motion;
template <class Guard, class Access>
class Reader;

class SharedTree {
 public:
  using FrameRef = NameRef;

  // Maps the region. The caller may close the descriptor. Throws RegionRefused and bad_alloc.
  explicit SharedTree(int descriptor);

  // All that follows is what Tree has under the same name, and throws Unanswered besides.
  [[nodiscard]] FrameId find(std::string_view name) const noexcept { return names_.find(name); }
  [[nodiscard]] FrameRef find_ref(std::string_view name) const noexcept {
    return names_.find_ref(name);
  }
  [[nodiscard]] bool is_current(FrameRef ref) const noexcept { return names_.is_current(ref); }
  [[nodiscard]] std::uint64_t ids_freed() const noexcept {
    return ids_freed_.load(std::memory_order_acquire);
  }
  [[nodiscard]] std::string name(FrameId id) const { return name_in(names_, id); }
  [[nodiscard]] std::string name(const Failure& failure, FrameId id) const {
    std::string name = id != 0 ? name_in(names_, id) : std::string();
    if (failure.ids_freed != ids_freed()) name.clear();
    return name;
  }
  [[nodiscard]] bool removed(FrameId id) const noexcept { return names_.removed(id); }
  [[nodiscard]] std::uint32_t size() const noexcept { return names_.size(); }
  [[nodiscard]] const Options& options() const noexcept { return region_.options(); }

  void lookup(const Query& query, Answer& answer) const;
  void lookup_batch(std::span<const Query> queries, std::span<Answer> answers) const;
  void lookup_transaction(std::span<const Query> queries, std::span<Answer> answers, ReadSet& reads,
                          std::size_t max_reads = static_cast<std::size_t>(-1)) const;
  void lookup_velocity(const VelocityQuery& query, VelocityAnswer& answer) const;
  void estimate(const EstimateQuery& query, EstimateAnswer& answer) const;
  // Of this process: the region has none.
  void set_motion_limits(std::string_view child, const MotionLimits& limits) {
    motion_limits_.set(child, limits);
  }
  MotionResult lookup_motion(const MotionQuery& query, Motion& motion, Answer& answer) const;
  Failure chain(const Query& query, std::vector<FrameId>& frames) const;
  [[nodiscard]] std::vector<NamedInfo> ancestors(std::span<const FrameId> starts,
                                                 Stamp stamp) const;
  [[nodiscard]] FrameId parent(FrameId frame, Stamp stamp) const;
  [[nodiscard]] FrameInfo info(FrameId frame) const;
  [[nodiscard]] const FrameEvents& events(FrameId id) const noexcept { return events_[id]; }
  [[nodiscard]] std::string authority(AuthorityId id) const {
    return id ? name_in(authorities_, id) : std::string();
  }

  // Throws Unanswered if the lease has lapsed.
  void check_lease() const;
  // As TreeState::read_names(); gives up as reads do.
  template <class Read>
  auto read_names(Read&& read) const {
    Patience patience;
    do {
      const std::uint64_t before = ids_freed();
      auto result = read();
      if (ids_freed() == before) [[likely]]
        return result;
    } while (patience.wait());
    throw Unanswered{Unanswered::Reason::busy};
  }

  [[nodiscard]] static constexpr bool is_recorded() noexcept { return false; }
  // Of the server that has the tree.
  [[nodiscard]] Startup startup() const noexcept { return startup_of(region_.header()); }

  // The time of CLOCK_MONOTONIC at which it lapses, as it is now.
  [[nodiscard]] std::int64_t lease_ns() const noexcept {
    return region_.header().lease_ns.load(std::memory_order_acquire);
  }

 private:
  using Names = NameReader<MappedMemory>;

  static std::string name_in(const Names& names, NameId id);
  static Names checked(const MappedRegion& region, const NameRoot& root, std::uint32_t max_names,
                       const MappedMemory& memory);
  // The loop of all reads: runs body(frames, patience) until it returns true, which says that what
  // it has read was the tree's state at one instant. Returns false if it never did. Throws
  // Unanswered if an attempt was unreadable, or the lease has lapsed.
  template <class Body>
  bool try_read(int attempts, Body&& body) const;
  template <class Guard>
  Reader<Guard, MappedFrames> reader_of(const MappedFrames& frames, Guard& guard) const noexcept;
  // Runs body(reader) until all that it read was the tree's state at one instant.
  template <class Body>
  void read(ReadSet& reads, Body&& body) const;
  // Runs body(frames, frame, version) until the frame did not change during the call.
  template <class Result, class Body>
  Result read_frame(FrameId id, Body&& body) const;
  std::size_t lookup_block(std::span<const Query> queries, std::span<Answer> answers) const;

  const MappedRegion region_;
  const MappedMemory memory_;
  const Frame* const frames_;
  const FrameEvents* const events_;
  const Names names_, authorities_;
  const std::uint32_t max_depth_;
  const std::atomic<bool>& ever_reparented_;
  const std::atomic<std::uint64_t>& ids_freed_;
  mutable EstimateCache estimate_cache_;
  MotionLimitTable motion_limits_;
};

}  // namespace ztf
