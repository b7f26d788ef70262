// One pair of frames at many times: a block of lookups in one transaction.
//
// The chain between the frames is found once, for the block's first time, and serves all its times.
// Reader::with_all_times() decides whether it does.
// A row that the block leaves unanswered, because a link has no sample at its time, needs an
// ordinary lookup, which reports the reason.
//
// Thread safety: a block belongs to one thread. What compute() gives is meaningful only after the
// guard has validated the chain (reads/guards.hpp).
#pragma once

#include <array>
#include <span>

#include "geometry/pose4.hpp"
#include "reads/walk.hpp"

namespace ztf {

class SampleBlock {
 public:
  static constexpr std::size_t kRows = 64;

  // Requires 1 to kRows queries `at` with the same target, source and limit of gaps.
  SampleBlock(std::span<const Query> queries, std::span<Answer> answers) noexcept
      : queries_(queries), answers_(answers) {}

  [[nodiscard]] const Query& first() const noexcept { return queries_[0]; }
  [[nodiscard]] Answer& first_answer() const noexcept { return answers_[0]; }

  // Answers the rows at whose time all links of the chain have a sample, and no gap is over the
  // limit. Requires the ring of each frame of both segments.
  void compute(const Chain& chain, std::span<const Ring> source_rings,
               std::span<const Ring> target_rings) noexcept;
  void leave_unanswered() noexcept { unanswered_.fill(true); }
  [[nodiscard]] bool unanswered(std::size_t row) const noexcept { return unanswered_[row]; }

 private:
  // One pose for each row, four in an element.
  using Poses = std::array<Pose4, kRows / 4>;
  using Intervals = std::array<SampleInterval, kRows>;  // of one link

  [[nodiscard]] std::size_t quads() const noexcept { return (queries_.size() + 3) / 4; }
  void compose_link(const Frame& frame, Ring ring, bool is_first, Poses& poses) noexcept;
  void find_gaps(const Frame& frame, const Intervals& intervals) noexcept;
  void compose_segment(const PathSegment& steps, std::span<const Ring> rings,
                       Poses& poses) noexcept;

  const std::span<const Query> queries_;
  const std::span<Answer> answers_;
  std::array<bool, kRows> unanswered_;
  std::array<Stamp, kRows> gaps_;  // meaningful only if there are any
  bool has_gaps_;
  bool ascending_;
};

}  // namespace ztf
