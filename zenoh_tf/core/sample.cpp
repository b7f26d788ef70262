// A block of times: its links followed one after the other, and multiplied.
#include "sample.hpp"

namespace ztf {

namespace {

// Where a frame's samples for one time after the other stand. Times that come in any order are not
// walked to: whether the next is near could not be foretold.
class Cursor {
 public:
  Cursor(const Frame& frame, bool ascending) noexcept
      : frame_(frame),
        ascending_(ascending),
        ring_(frame.ring.load(std::memory_order_acquire)),
        newest_(frame.latest.stamp.load(std::memory_order_acquire)) {}

  // As place_at(); false where the link has no sample for the time.
  ZTF_HOT bool move_to(Stamp stamp, Bracket& found) noexcept {
    if (!ascending_ || slot_ == Place::kNewest || !ring_ || stamp >= newest_ || !walk_to(stamp)) {
      const Place place = place_at(frame_, stamp, found);
      const bool served = place.kind == Place::Kind::ok;
      slot_ = served ? place.slot : Place::kNewest;
      return served;
    }
    found.older = &ring_.sample(slot_);
    found.newer = &ring_.sample(slot_ + 1);
    found.time = stamp;
    return true;
  }

 private:
  static constexpr int kSteps = 4;

  // To the last sample not after a time before the newest, if that is near. In a collision,
  // somewhere in the ring.
  ZTF_HOT bool walk_to(Stamp stamp) noexcept {
    if (ring_.stamp(slot_) > stamp) return false;
    for (int i = 0; i < kSteps; ++i) {
      if (ring_.stamp(slot_ + 1) > stamp) return true;
      ++slot_;
    }
    return false;
  }

  const Frame& frame_;
  const bool ascending_;
  const Ring ring_;
  const Stamp newest_;
  std::uint32_t slot_ = Place::kNewest;  // that is: to be searched for
};

}  // namespace

ZTF_CLONES void SampleBlock::follow(const Step& step, bool is_first, Column& poses) noexcept {
  fault_point();
  Cursor cursor(*step.frame, ascending_);
  for (std::size_t quad = 0; quad < quads(); ++quad) {
    Bracket rows[4];
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t row = std::min(4 * quad + i, queries_.size() - 1);
      left_out_[row] |= !cursor.move_to(queries_[row].stamp, rows[i]);
    }
    const PoseQuad pose = interpolate(rows[0], rows[1], rows[2], rows[3]);
    poses[quad] = is_first ? pose : pose * poses[quad];
  }
}

void SampleBlock::compose(const Side& side, Column& poses) noexcept {
  for (std::size_t i = 0; i < side.links; ++i) follow(side.steps[i], i == 0, poses);
}

ZTF_CLONES void SampleBlock::answer(const Chain& chain) noexcept {
  const auto& [source, target, meeting] = chain;
  left_out_.fill(false);
  ascending_ = std::ranges::is_sorted(queries_, {}, &Query::stamp);
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
    answer.pose = unpacked(poses[row / 4], row % 4);
  }
}

}  // namespace ztf
