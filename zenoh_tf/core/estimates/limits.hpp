// Declared limits of motion, and how wrong they allow a pose to be.
//
// Thread safety: MotionLimitTable: every function, from any thread; its holder takes no other lock.
#pragma once

#include <algorithm>
#include <atomic>
#include <limits>
#include <map>
#include <mutex>
#include <string>
#include <string_view>

#include "estimates/estimate.hpp"

namespace ztf {

struct LinkNow;
struct Residual;

// Of the motion of a child in its parent, at most; infinite where none is declared. And of the
// clock that stamps the link's samples.
struct MotionLimits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double speed = kNone, accel = kNone;      // m/s, m/s^2, of the child's origin
  double rate = kNone, rate_accel = kNone;  // rad/s, rad/s^2
  double clock_error = 0;                   // seconds, ahead or behind

  [[nodiscard]] bool any() const noexcept {
    return std::min(std::min(speed, accel), std::min(rate, rate_accel)) < kNone || clock_error > 0;
  }
};

// The limits by the name of the child.
class MotionLimitTable {
 public:
  // Replaces a frame's limits; none removes them. Throws bad_alloc.
  void set(std::string_view child, const MotionLimits& limits);
  [[nodiscard]] bool empty() const noexcept { return size_.load(std::memory_order_acquire) == 0; }
  [[nodiscard]] MotionLimits find(std::string_view child) const;
  // Returns how often limits were set.
  [[nodiscard]] std::uint64_t version() const noexcept {
    return version_.load(std::memory_order_acquire);
  }
  // Returns a copy of all.
  [[nodiscard]] std::map<std::string, MotionLimits, std::less<>> all() const {
    const std::lock_guard lock(mutex_);
    return limits_;
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, MotionLimits, std::less<>> limits_;
  std::atomic<std::size_t> size_{0};
  std::atomic<std::uint64_t> version_{0};
};

// Returns how far a link's pose, as carried on, may be off if the motion keeps within the limits.
// Infinite where they do not bound it.
Residual deviation(const LinkNow& link, Predictor predictor, const Pose& carried,
                   const MotionLimits& limits) noexcept;

// Returns how far a link may go in the time by which its clock may be off. Infinite where its speed
// or its rate has no limit: what it did within its history is no guarantee.
Residual clock_deviation(const LinkNow& link, const MotionLimits& limits) noexcept;

}  // namespace ztf
