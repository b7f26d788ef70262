// What limits of motion allow.
#include "estimates/limits.hpp"

#include "estimates/path.hpp"
#include "geometry/screw.hpp"

namespace ztf {

namespace {

double seconds(Stamp from, Stamp to) noexcept { return elapsed_ns(from, to) * 1e-9; }

Vec3 minus(const Pose& a, const Pose& b) noexcept { return {a.x - b.x, a.y - b.y, a.z - b.z}; }

double turn_between(const Pose& a, const Pose& b) noexcept {
  return residual_between(a, b).radians;
}

// Zero times infinity is no bound.
double product(double limit, double factor) noexcept {
  return limit == MotionLimits::kNone ? limit : limit * factor;
}

// Between two samples: from the nearer one by the speed, from the chord by the acceleration.
Residual between(const LinkNow& link, const Pose& pose, const MotionLimits& limits) noexcept {
  const double span = seconds(link.older.stamp, link.newer.stamp), after = link.elapsed * 1e-9;
  // The sample after it has another parent, so the one before it is held.
  if (!(span > 0)) return {product(limits.speed, after), product(limits.rate, after)};
  const double before = std::max(span - after, 0.0), nearest = std::min(after, before);
  const Pose& near = after <= before ? link.older.pose : link.newer.pose;
  return {std::min(product(limits.speed, nearest) + norm(minus(pose, near)),
                   product(limits.accel, 0.5 * after * before)),
          std::min(product(limits.rate, nearest) + turn_between(pose, near),
                   product(limits.rate_accel, 0.5 * after * before))};
}

}  // namespace

void MotionLimitTable::set(std::string_view child, const MotionLimits& limits) {
  const std::lock_guard lock(mutex_);
  if (limits.any())
    limits_.insert_or_assign(std::string(child), limits);
  else if (const auto at = limits_.find(child); at != limits_.end())
    limits_.erase(at);
  size_.store(limits_.size(), std::memory_order_release);
  version_.fetch_add(1, std::memory_order_acq_rel);
}

MotionLimits MotionLimitTable::find(std::string_view child) const {
  const std::lock_guard lock(mutex_);
  const auto at = limits_.find(child);
  return at == limits_.end() ? MotionLimits{} : at->second;
}

Residual deviation(const LinkNow& link, Predictor predictor, const Pose& carried,
                   const MotionLimits& limits) noexcept {
  using Kind = LinkNow::Kind;
  if (link.kind == Kind::fixed || link.kind == Kind::exact) return {0, 0};
  if (link.kind == Kind::between) return between(link, carried, limits);
  // The velocity at the newest sample is the mean one of the window before it, but for what the
  // acceleration changes in half of the window. The body then deviates from a straight line, and
  // from a constant rotation, by what the acceleration makes of the time.
  const double time = static_cast<double>(link.lag) * 1e-9;
  const Pose& last = link.older.pose;
  const StampedPose& before = link.before[0];
  const double window = seconds(before.stamp, link.older.stamp);
  Residual by_accel{MotionLimits::kNone, MotionLimits::kNone};
  if (window > 0 && link.kind == Kind::carried) {
    const Vec3 shift = minus(last, before.pose), moved = minus(carried, last);
    const double ratio = time / window, half = 0.5 * time * (time + window);
    by_accel = {
        product(limits.accel, half) +
            norm({moved.x - ratio * shift.x, moved.y - ratio * shift.y, moved.z - ratio * shift.z}),
        product(limits.rate_accel, half)};
    const Pose turned = carry_on(before.pose, last, ratio);
    if (predictor != Predictor::twist_1) by_accel.radians += turn_between(turned, carried);
  }
  const Residual by_speed{product(limits.speed, time) + norm(minus(carried, last)),
                          product(limits.rate, time) + turn_between(carried, last)};
  return {std::min(by_speed.metres, by_accel.metres), std::min(by_speed.radians, by_accel.radians)};
}

Residual clock_deviation(const LinkNow& link, const MotionLimits& limits) noexcept {
  if (link.kind == LinkNow::Kind::fixed || !(limits.clock_error > 0)) return {0, 0};
  return {product(limits.speed, limits.clock_error), product(limits.rate, limits.clock_error)};
}

}  // namespace ztf
