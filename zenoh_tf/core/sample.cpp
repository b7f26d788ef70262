// A block of times: its links followed one after the other, and composed.
#include "sample.hpp"

namespace ztf {

namespace {

// The samples around a time, and how far it lies between them: 0 where one of them is the answer.
struct Between {
  Pose older, newer;
  double ratio;
};

ZTF_HOT PosePair packed(const Pose& a, const Pose& b) noexcept {
  using Pair = NumberPair;
  return {Pair{a.x, b.x},   Pair{a.y, b.y},   Pair{a.z, b.z},  Pair{a.qx, b.qx},
          Pair{a.qy, b.qy}, Pair{a.qz, b.qz}, Pair{a.qw, b.qw}};
}
ZTF_HOT Pose unpacked(const PosePair& p, int i) noexcept {
  return {p.x[i], p.y[i], p.z[i], p.qx[i], p.qy[i], p.qz[i], p.qw[i]};
}

// As interpolate() of each.
ZTF_HOT PosePair interpolate(const Between (&rows)[2]) noexcept {
  const PosePair a = packed(rows[0].older, rows[1].older), b = packed(rows[0].newer, rows[1].newer);
  const NumberPair ratio{rows[0].ratio, rows[1].ratio};
  const NumberPair zero{}, one = zero + 1.0;
  const NumberPair dot = detail::dot(a, b);
  const NumberPair sign = dot < zero ? -one : one;
  const NumberPair rest = one - (dot * sign > one ? one : dot * sign);
  if (!(rest[0] < detail::kClose && rest[1] < detail::kClose)) [[unlikely]]
    return packed(interpolate(rows[0].older, rows[0].newer, rows[0].ratio),
                  interpolate(rows[1].older, rows[1].newer, rows[1].ratio));
  NumberPair wa, wb;
  detail::weights_if_close(rest, ratio, wa, wb);
  return detail::mix(a, b, ratio, wa, wb * sign);
}

// Where a frame's samples for one time after the other stand.
class Cursor {
 public:
  Cursor(const Frame& frame, std::uint32_t slot) noexcept
      : frame_(frame),
        ring_(frame.ring.load(std::memory_order_acquire)),
        newest_(frame.latest_stamp.load(std::memory_order_acquire)),
        slot_(slot) {}

  // As place_at(); false where the link has no sample for the time, or led elsewhere.
  ZTF_HOT bool move_to(Stamp stamp, FrameId parent, Between& found) noexcept {
    if (slot_ != Place::kNewest && ring_ && stamp < newest_ && ring_->stamp(slot_) <= stamp) {
      // Not beyond the newest, for that is after the time; in a collision, somewhere in the ring.
      for (int i = 0; i < kSteps; ++i) {
        if (ring_->stamp(slot_ + 1) > stamp) return load(stamp, parent, found);
        ++slot_;
      }
    }
    const Place place = place_at(frame_, stamp);
    if (place.kind != Place::Kind::ok || place.parent != parent) {
      slot_ = Place::kNewest;
      return false;
    }
    slot_ = place.slot;
    if (slot_ != Place::kNewest) return load(stamp, parent, found);
    found.older = found.newer = frame_.latest_pose.load();
    found.ratio = 0;
    return true;
  }

 private:
  static constexpr int kSteps = 8;

  ZTF_HOT bool load(Stamp stamp, FrameId parent, Between& found) const noexcept {
    if (!ring_) return false;  // only in a collision with a writer
    const Stamp older = ring_->stamp(slot_);
    found.older = ring_->pose(slot_);
    if (older == stamp || ring_->parent(slot_ + 1) != parent) [[unlikely]] {
      found.newer = found.older;
      found.ratio = 0;
    } else {
      found.newer = ring_->pose(slot_ + 1);
      found.ratio = share(older, stamp, ring_->stamp(slot_ + 1));
    }
    return ring_->parent(slot_) == parent;
  }

  const Frame& frame_;
  const Ring* const ring_;
  const Stamp newest_;
  std::uint32_t slot_;  // kNewest: to be searched for
};

}  // namespace

template <bool multiply>
void SampleBlock::follow(const Step& step, FrameId parent, Column& poses) noexcept {
  fault_point();
  Cursor cursor(*step.frame, step.slot);
  Between rows[2] = {};
  for (std::size_t pair = 0; pair < pairs(); ++pair) {
    for (std::size_t i = 0; i < 2; ++i) {
      const std::size_t row = std::min(2 * pair + i, queries_.size() - 1);
      left_out_[row] |= !cursor.move_to(queries_[row].stamp, parent, rows[i]);
    }
    poses[pair] = multiply ? interpolate(rows) * poses[pair] : interpolate(rows);
  }
}

// The links from..to of a side, multiplied in the order of compose.cpp.
void SampleBlock::product(const Side& side, std::size_t from, std::size_t to, const Frame* meeting,
                          const Frame* frames, Column& poses) noexcept {
  for (std::size_t i = from; i < to; ++i) {
    const auto parent = static_cast<FrameId>(side.frame_above(i + 1, meeting) - frames);
    if (i == from)
      follow<false>(side.steps[i], parent, poses);
    else
      follow<true>(side.steps[i], parent, poses);
  }
}

void SampleBlock::compose(const Side& side, const Frame* meeting, const Frame* frames,
                          Column& poses) noexcept {
  const std::size_t half = side.links - side.links / 2;
  product(side, 0, half, meeting, frames, poses);
  if (side.links == 1) return;
  Column upper;
  product(side, half, side.links, meeting, frames, upper);
  for (std::size_t i = 0; i < pairs(); ++i) poses[i] = upper[i] * poses[i];
}

void SampleBlock::answer(const Chain& chain, const Frame* frames) noexcept {
  const auto [source, target, meeting] = chain;
  left_out_.fill(false);
  Column poses, from_target;
  if (source.links != 0) compose(source, meeting, frames, poses);
  if (target.links != 0) {
    compose(target, meeting, frames, from_target);
    for (std::size_t i = 0; i < pairs(); ++i)
      poses[i] = source.links == 0 ? inverse(from_target[i]) : inverse(from_target[i]) * poses[i];
  }
  for (std::size_t row = 0; row < queries_.size(); ++row) {
    Answer& answer = answers_[row];
    answer.failure.code = Code::ok;
    answer.stamp = queries_[row].stamp;
    answer.pose = unpacked(poses[row / 2], row % 2);
  }
}

}  // namespace ztf
