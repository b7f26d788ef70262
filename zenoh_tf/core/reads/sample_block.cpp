// Computes a block link by link: each link at all times of the block, four times at once.
#include "reads/sample_block.hpp"

#include <utility>

#include "histories/four_samples.hpp"
#include "histories/gap.hpp"

namespace ztf {

// Multiplies the poses by the link's poses from the left; the first link's replace them.
ZTF_MULTIVERSION void SampleBlock::compose_link(const Frame& frame, Ring ring, bool is_first,
                                                Poses& poses) noexcept {
  yield_point();
  // All samples are found before any pose is computed, so that the loads of the next times overlap
  // with each other instead of waiting for the arithmetic.
  Intervals intervals;
  HistoryCursor cursor(frame, ring, ascending_);
  for (std::size_t row = 0; row < 4 * quads(); ++row) {
    const Stamp time = queries_[std::min(row, queries_.size() - 1)].stamp;
    if (!cursor.find(time, intervals[row])) unanswered_[row] = true;
  }
  Double4 longest{};
  for (std::size_t quad = 0; quad < quads(); ++quad) {
    const SampleInterval* const four = &intervals[4 * quad];
    const Pose4 pose = interpolate(four[0], four[1], four[2], four[3], longest);
    poses[quad] = is_first ? pose : pose * poses[quad];
  }
  // With a limit every interval is compared with it.
  const double rate = queries_[0].max_gap < 0 ? rate_for_gaps(frame) : 1e300;
  if (largest(longest) * rate > kSuspectPeriods) [[unlikely]]
    find_gaps(frame, intervals);
}

// The slow path of finding gaps, for a link. A row over the limit stays unanswered.
[[gnu::noinline]] void SampleBlock::find_gaps(const Frame& frame,
                                              const Intervals& intervals) noexcept {
  if (!std::exchange(has_gaps_, true)) gaps_.fill(0);
  for (std::size_t row = 0; row < queries_.size(); ++row) {
    const Stamp interval = interpolated_ns(intervals[row]);
    if (exceeds(frame, interval, queries_[0].max_gap)) unanswered_[row] = true;
    Stamp& gap = gaps_[row];
    if (interval > gap && is_gap(frame, static_cast<double>(interval))) gap = interval;
  }
}

void SampleBlock::compose_segment(const PathSegment& steps, std::span<const Ring> rings,
                                  Poses& poses) noexcept {
  for (std::size_t i = 0; i < steps.size(); ++i)
    compose_link(*steps[i].frame, rings[i], i == 0, poses);
}

ZTF_MULTIVERSION void SampleBlock::compute(const Chain& chain, std::span<const Ring> source_rings,
                                           std::span<const Ring> target_rings) noexcept {
  unanswered_.fill(false);
  has_gaps_ = false;
  ascending_ = std::is_sorted(queries_.begin(), queries_.end(),
                              [](const Query& a, const Query& b) { return a.stamp < b.stamp; });
  Poses poses, from_target;
  compose_segment(chain.source, source_rings, poses);
  compose_segment(chain.target, target_rings, from_target);
  if (!chain.target.empty())
    for (std::size_t i = 0; i < quads(); ++i)
      poses[i] =
          chain.source.empty() ? inverse(from_target[i]) : inverse(from_target[i]) * poses[i];
  for (std::size_t row = 0; row < queries_.size(); ++row) {
    Answer& answer = answers_[row];
    answer.failure.code = Code::ok;
    answer.stamp = queries_[row].stamp;
    answer.gap = has_gaps_ ? gaps_[row] : 0;
    answer.pose = lane(poses[row / 4], row % 4);
  }
}

}  // namespace ztf
