// How a motion is copied, and its poses computed, four times at once.
#include "reads/motion.hpp"

namespace ztf {

Motion::Interval Motion::interval_between(Stamp from, const Pose& older, Stamp to,
                                          const Pose& newer) noexcept {
  const double dot =
      older.qx * newer.qx + older.qy * newer.qy + older.qz * newer.qz + older.qw * newer.qw;
  const double sign = dot < 0 ? -1.0 : 1.0;  // q and -q are the same rotation
  const Pose end{newer.x - older.x, newer.y - older.y, newer.z - older.z, sign * newer.qx,
                 sign * newer.qy,   sign * newer.qz,   sign * newer.qw};
  // The chord and its complement give a small angle without loss, unlike the arc cosine.
  const auto norm = [&](double s) {
    return std::sqrt((older.qx + s * end.qx) * (older.qx + s * end.qx) +
                     (older.qy + s * end.qy) * (older.qy + s * end.qy) +
                     (older.qz + s * end.qz) * (older.qz + s * end.qz) +
                     (older.qw + s * end.qw) * (older.qw + s * end.qw));
  };
  // The sine of any angle below 1e-9 is the angle, so a rotation that does not change needs no case
  // of its own.
  const double half_angle = std::max(2 * std::atan2(norm(-1), norm(1)), 1e-9);
  const double elapsed = elapsed_ns(from, to);
  return {from, to,         elapsed > 0 ? 1 / elapsed : 0, older,
          end,  half_angle, 1 / std::sin(half_angle)};
}

bool Motion::add(const Frame& frame, Ring ring, Stamp first, Stamp last, bool inverted,
                 Stamp max_gap) {
  yield_point();
  const auto acquire = std::memory_order_acquire;
  Factor& factor = factors_.emplace_back();
  factor.inverted = inverted;
  const std::uint32_t count = std::min(frame.count.load(acquire), ring.capacity());
  if (frame.is_static.load(acquire) || !ring || count < 2) {
    // A single sample serves only its own time, which was looked up before.
    factor.constant = inverted ? inverse(frame.latest.pose.load()) : frame.latest.pose.load();
    return true;
  }
  const std::uint32_t begin = frame.first.load(acquire);
  std::uint32_t low = 0, high = count;  // bisects for the newest sample that is not after `first`
  while (high - low > 1) {
    const std::uint32_t middle = low + (high - low) / 2;
    (ring.stamp(begin + middle) <= first ? low : high) = middle;
  }
  if (low + 1 == count) --low;  // the newest sample's time is the end of an interval
  Stamp from = ring.stamp(begin + low);
  Pose older = ring.sample(begin + low).pose.load();
  do {
    const Stamp to = ring.stamp(begin + ++low);
    const Pose newer = ring.sample(begin + low).pose.load();
    factor.intervals.push_back(interval_between(from, older, to, newer));
    has_gap_ = has_gap_ || exceeds(frame, static_cast<Stamp>(span_ns(from, to)), max_gap);
    from = to;
    older = newer;
  } while (from < last && low + 1 < count);
  return factor.intervals.front().from <= first && last <= from;  // false: a torn read
}

bool Motion::copy(const Chain& chain, std::span<const Ring> source_rings,
                  std::span<const Ring> target_rings, Stamp first, Stamp last, Stamp max_gap) {
  clear();
  // X_fixed_source is the inverse of the product of the target's links, from the ancestor down, and
  // then the product of the source's.
  for (std::size_t i = 0; i < chain.target.size(); ++i)
    if (!add(*chain.target[i].frame, target_rings[i], first, last, true, max_gap)) return false;
  for (std::size_t i = chain.source.size(); i-- > 0;)
    if (!add(*chain.source[i].frame, source_rings[i], first, last, false, max_gap)) return false;
  return true;
}

void Motion::fold_constants() {
  std::vector<Factor> folded;
  for (Factor& factor : factors_) {
    if (!folded.empty() && folded.back().intervals.empty() && factor.intervals.empty())
      folded.back().constant = folded.back().constant * factor.constant;
    else
      folded.push_back(std::move(factor));
  }
  factors_ = std::move(folded);
}

void Motion::Factor::find(Stamp time) noexcept {
  const auto holds = [&](std::size_t i) {
    return intervals[i].from <= time && time < intervals[i].to;
  };
  if (holds(last)) return;
  if (last + 1 < intervals.size() && holds(last + 1)) {
    ++last;
    return;
  }
  const auto after = std::upper_bound(intervals.begin() + 1, intervals.end(), time,
                                      [](Stamp t, const Interval& i) { return t < i.from; });
  last = static_cast<std::size_t>(after - intervals.begin()) - 1;
}

ZTF_ALWAYS_INLINE Pose4 Motion::interpolate_four(Factor& factor, const Stamp* times) noexcept {
  const Interval* in[4];
  for (std::size_t i = 0; i < 4; ++i) {
    factor.find(times[i]);
    in[i] = &factor.intervals[factor.last];
  }
  const auto pose = [&](auto&& get) __attribute__((always_inline)) {
    const Double4 ratio =
        Double4{elapsed_ns(in[0]->from, times[0]), elapsed_ns(in[1]->from, times[1]),
                elapsed_ns(in[2]->from, times[2]), elapsed_ns(in[3]->from, times[3])} *
        get([](const Interval& i) { return i.per_ns; });
    const Double4 angle = get([](const Interval& i) { return i.half_angle; });
    const Double4 scale = get([](const Interval& i) { return i.scale; });
    const Double4 a = (1.0 - ratio) * angle, b = ratio * angle;
    const Double4 wa = a * detail::sine_to_angle(a * a) * scale;
    const Double4 wb = b * detail::sine_to_angle(b * b) * scale;
    const auto old = [&](double Pose::* c) {
      return get([c](const Interval& i) { return i.older.*c; });
    };
    const auto change = [&](double Pose::* c) {
      return get([c](const Interval& i) { return i.change.*c; });
    };
    return Pose4{
        old(&Pose::x) + ratio * change(&Pose::x),     old(&Pose::y) + ratio * change(&Pose::y),
        old(&Pose::z) + ratio * change(&Pose::z),     wa * old(&Pose::qx) + wb * change(&Pose::qx),
        wa * old(&Pose::qy) + wb * change(&Pose::qy), wa * old(&Pose::qz) + wb * change(&Pose::qz),
        wa * old(&Pose::qw) + wb * change(&Pose::qw)};
  };
  // Times of a sweep are dense: mostly all four lie between the same samples.
  const Pose4 result =
      in[0] == in[1] && in[0] == in[2] && in[0] == in[3]
          ? pose([&](auto&& number) { return Double4{} + number(*in[0]); })
          : pose([&](auto&& number) {
              return Double4{number(*in[0]), number(*in[1]), number(*in[2]), number(*in[3])};
            });
  return factor.inverted ? inverse(result) : result;
}

ZTF_ALWAYS_INLINE Pose4 Motion::product(const Stamp* times) noexcept {
  Pose4 result;
  bool is_first = true;
  for (Factor& factor : factors_) {
    Pose4 pose;
    if (factor.intervals.empty()) {
      const Pose& p = factor.constant;
      const Double4 zero{};
      pose = {zero + p.x,  zero + p.y,  zero + p.z, zero + p.qx,
              zero + p.qy, zero + p.qz, zero + p.qw};
    } else {
      pose = interpolate_four(factor, times);
    }
    result = is_first ? pose : result * pose;
    is_first = false;
  }
  return result;
}

ZTF_MULTIVERSION void Motion::compute_four(const Stamp* times, PointMap* maps) noexcept {
  PointMap::of(product(times), maps);
}

void Motion::fix_at(Stamp at) {
  const Stamp times[4] = {at, at, at, at};
  const Pose X_fixed_source = lane(product(times), 0);
  Factor& left = *factors_.emplace(factors_.begin());
  left.constant = inverse(X_fixed_source);
  fold_constants();
}

void Motion::compute(std::span<const Stamp> times, PointMap* maps) noexcept {
  for (std::size_t i = 0; i < times.size(); i += 4) {
    if (i + 4 <= times.size()) {
      compute_four(&times[i], &maps[i]);
      continue;
    }
    Stamp padded[4];
    for (std::size_t k = 0; k < 4; ++k) padded[k] = times[std::min(i + k, times.size() - 1)];
    compute_four(padded, &maps[i]);
  }
}

}  // namespace ztf
