// One pair of frames at many times: a block of times in one transaction.
//
// The chain between the two is found once, for the block's first time. Each of
// its links is then followed through all times with a cursor into its history,
// and the poses of four times are computed at once. That holds while no frame has
// had samples of two parents (Reader::never_reparented()); from then on all times are
// left to ordinary lookups. So is a time at which a link has no sample, which a
// lookup explains.
//
// Thread safety: a block lives on one thread's stack. What answer() gives is
// good only once the guard says so (guards.hpp).
#pragma once

#include <array>
#include <span>

#include "pose4.hpp"
#include "walk.hpp"

namespace ztf {

// The times of a block: of whole quads, the last time again where there are no more.
struct BlockTimes {
  static constexpr std::size_t kRows = 64;
  std::array<Stamp, kRows> rows;
  Stamp earliest, latest;
  bool ascending;
};

class SampleBlock {
 public:
  static constexpr std::size_t kRows = BlockTimes::kRows;

  // One row at least and kRows at most, all `at`, of one target and one source.
  SampleBlock(std::span<const Query> queries, std::span<Answer> answers) noexcept
      : queries_(queries), answers_(answers) {}

  [[nodiscard]] const Query& first() const noexcept { return queries_[0]; }
  [[nodiscard]] Answer& first_answer() const noexcept { return answers_[0]; }

  // Answers the rows that the chain serves,
  void answer(const Chain& chain) noexcept;
  // or none.
  void leave_unanswered() noexcept { unanswered_.fill(true); }
  [[nodiscard]] bool unanswered(std::size_t row) const noexcept { return unanswered_[row]; }

 private:
  // Without the identities that poses begin as.
  union Column {
    Column() noexcept {}
    Pose4& operator[](std::size_t quad) noexcept { return quads[quad]; }
    std::array<Pose4, kRows / 4> quads;
  };

  [[nodiscard]] std::size_t quads() const noexcept { return (queries_.size() + 3) / 4; }
  void take_times() noexcept;
  void follow(const PathStep& step, bool is_first, Column& poses) noexcept;
  void compose(const PathSegment& side, Column& poses) noexcept;

  const std::span<const Query> queries_;
  const std::span<Answer> answers_;
  std::array<bool, kRows> unanswered_;
  BlockTimes times_;
};

}  // namespace ztf
