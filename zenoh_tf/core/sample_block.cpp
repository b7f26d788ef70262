// A block of times: its links followed one after the other, and multiplied.
#include "sample_block.hpp"

namespace ztf {

namespace {

// Finds a frame's samples for one time after the other.
class HistoryCursor {
 public:
  HistoryCursor(const Frame& frame, const BlockTimes& times) noexcept
      : frame_(frame),
        regular_(frame),
        is_regular_(regular_.spans(times.earliest, times.latest)),
        ascending_(times.ascending) {}

  // As find_link(); false where the link has no sample for the time.
  ZTF_ALWAYS_INLINE bool move_to(Stamp time, SampleInterval& found) noexcept {
    if (walks_ ? walk_to(time, found) : is_regular_ && regular_.find(time, found)) [[likely]]
      return true;
    return search(time, found);
  }

 private:
  static constexpr int kSteps = 4;

  // From then on ascending times are walked to. Whether others are near could not be foretold.
  [[gnu::noinline]] bool search(Stamp time, SampleInterval& found) noexcept {
    const bool served = find_link(frame_, time, found).status == LinkLookup::Status::ok;
    const Ring ring = regular_.ring();
    walks_ = ascending_ && served && ring && found.older != found.newer;
    if (walks_) slot_ = ring.index_of(*found.older);
    return served;
  }

  // To the last sample not after a time, from that of an earlier one, if that is near. In a
  // collision, to somewhere in the ring.
  ZTF_ALWAYS_INLINE bool walk_to(Stamp time, SampleInterval& found) noexcept {
    const Ring ring = regular_.ring();
    if (time >= regular_.newest() || ring.stamp(slot_) > time) return false;
    for (int i = 0; i < kSteps; ++i) {
      const Sample& newer = ring.sample(slot_ + 1);
      if (newer.stamp.load(std::memory_order_acquire) > time) {
        found.older = &ring.sample(slot_);
        found.newer = &newer;
        found.time = time;
        return true;
      }
      ++slot_;
    }
    return false;
  }

  const Frame& frame_;
  const UniformHistory regular_;
  const bool is_regular_;
  const bool ascending_;
  bool walks_ = false;
  std::uint32_t slot_ = 0;  // what was found last, where it walks
};

}  // namespace

// First where, then what: finding the next times' samples does not wait for the arithmetic of the
// times before, which is long.
ZTF_MULTIVERSION void SampleBlock::follow(const PathStep& step, bool is_first,
                                          Column& poses) noexcept {
  yield_point();
  HistoryCursor cursor(*step.frame, times_);
  SampleInterval rows[kRows];
  for (std::size_t row = 0; row < 4 * quads(); ++row)
    if (!cursor.move_to(times_.rows[row], rows[row])) unanswered_[row] = true;
  for (std::size_t quad = 0; quad < quads(); ++quad) {
    const SampleInterval* const four = rows + 4 * quad;
    const Pose4 pose = interpolate(four[0], four[1], four[2], four[3]);
    poses[quad] = is_first ? pose : pose * poses[quad];
  }
}

void SampleBlock::compose(const PathSegment& side, Column& poses) noexcept {
  for (std::size_t i = 0; i < side.links; ++i) follow(side.steps[i], i == 0, poses);
}

void SampleBlock::take_times() noexcept {
  times_.ascending = true;
  times_.earliest = times_.latest = queries_[0].stamp;
  for (std::size_t row = 0; row < 4 * quads(); ++row) {
    const Stamp time = row < queries_.size() ? queries_[row].stamp : times_.rows[row - 1];
    times_.ascending &= times_.latest <= time;
    times_.earliest = std::min(times_.earliest, time);
    times_.latest = std::max(times_.latest, time);
    times_.rows[row] = time;
  }
}

ZTF_MULTIVERSION void SampleBlock::answer(const Chain& chain) noexcept {
  const auto& [source, target, common_ancestor] = chain;
  unanswered_.fill(false);
  take_times();
  Column poses, from_target;
  compose(source, poses);
  compose(target, from_target);
  if (target.links != 0)
    for (std::size_t i = 0; i < quads(); ++i)
      poses[i] = source.links == 0 ? inverse(from_target[i]) : inverse(from_target[i]) * poses[i];
  for (std::size_t row = 0; row < queries_.size(); ++row) {
    Answer& answer = answers_[row];
    answer.failure.code = Code::ok;
    answer.stamp = queries_[row].stamp;
    answer.pose = lane(poses[row / 4], row % 4);
  }
}

}  // namespace ztf
