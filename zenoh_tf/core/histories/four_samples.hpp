// The poses of four links at one time, or of one link at four times, interpolated at once.
//
// Thread safety: any reader may call these functions (records/frame.hpp).
// Invariant: as in geometry/pose4.hpp.
#pragma once

#include "geometry/pose4.hpp"
#include "histories/history.hpp"

namespace ztf {

// Four samples; [i] gives component i of their poses.
struct Sample4 {
  const Sample &a, &b, &c, &d;

  ZTF_ALWAYS_INLINE Double4 operator[](int i) const noexcept {
    return Double4{a.pose[i], b.pose[i], c.pose[i], d.pose[i]};
  }
};

// Returns how far each time lies between its two samples, from 0 to 1; 0 if they are the same.
// Raises `longest` to the nanoseconds between the samples.
ZTF_ALWAYS_INLINE Double4 interpolation_ratios(const SampleInterval& a, const SampleInterval& b,
                                               const SampleInterval& c, const SampleInterval& d,
                                               Double4& longest) noexcept {
  const auto acquire = std::memory_order_acquire;
  const Stamp from[4] = {a.older->stamp.load(acquire), b.older->stamp.load(acquire),
                         c.older->stamp.load(acquire), d.older->stamp.load(acquire)};
  const Double4 span{elapsed_ns(from[0], a.newer->stamp.load(acquire)),
                     elapsed_ns(from[1], b.newer->stamp.load(acquire)),
                     elapsed_ns(from[2], c.newer->stamp.load(acquire)),
                     elapsed_ns(from[3], d.newer->stamp.load(acquire))};
  longest = span > longest ? span : longest;
  const Double4 passed{elapsed_ns(from[0], a.time), elapsed_ns(from[1], b.time),
                       elapsed_ns(from[2], c.time), elapsed_ns(from[3], d.time)};
  const Double4 zero{};
  return span > zero ? passed / span : zero;
}

// The slow path for large angles: one pose after the other.
[[gnu::noinline]] inline Pose4 interpolate_each(const SampleInterval* const (&intervals)[4],
                                                const Double4& ratio) noexcept {
  Pose p[4];
  for (std::size_t i = 0; i < 4; ++i)
    p[i] =
        interpolate(intervals[i]->older->pose.load(), intervals[i]->newer->pose.load(), ratio[i]);
  const auto component = [&](double Pose::* c) {
    return Double4{p[0].*c, p[1].*c, p[2].*c, p[3].*c};
  };
  return {component(&Pose::x),  component(&Pose::y),  component(&Pose::z), component(&Pose::qx),
          component(&Pose::qy), component(&Pose::qz), component(&Pose::qw)};
}

// As detail::slerp_weights(). A call, so that it takes no registers from slower links.
[[gnu::noinline]] inline void slerp_weights4(const Double4& versine, const Double4& ratio,
                                             Double4& wa, Double4& wb) noexcept {
  detail::slerp_weights(versine, ratio, wa, wb);
}

// Interpolates each of the four, and raises `longest` to the nanoseconds between its samples.
// Computes the rotations first, to keep fewer values in registers.
ZTF_ALWAYS_INLINE Pose4 interpolate(const SampleInterval& a, const SampleInterval& b,
                                    const SampleInterval& c, const SampleInterval& d,
                                    Double4& longest) noexcept {
  const Sample4 older{*a.older, *b.older, *c.older, *d.older};
  const Sample4 newer{*a.newer, *b.newer, *c.newer, *d.newer};
  const Double4 ratio = interpolation_ratios(a, b, c, d, longest);
  const Double4 ax = older[3], bx = newer[3], ay = older[4], by = newer[4];
  const Double4 az = older[5], bz = newer[5], aw = older[6], bw = newer[6];
  const Double4 dot = (ax * bx + ay * by) + (az * bz + aw * bw);
  constexpr long long kSign = std::numeric_limits<long long>::min();
  const Int4 sign = reinterpret_cast<Int4>(dot) & kSign;  // q and -q are the same rotation
  const Double4 versine = 1.0 - flip_sign(dot, sign);
  Double4 wa, wb;
  if (const double most = largest(versine); most < detail::kSmallVersine) [[likely]]
    detail::slerp_small_weights(versine, ratio, wa, wb);
  else if (most < detail::kMaxVersine)
    slerp_weights4(versine, ratio, wa, wb);
  else
    return interpolate_each({&a, &b, &c, &d}, ratio);
  wb = flip_sign(wb, sign);
  const Double4 x = older[0], dx = newer[0] - x;
  const Double4 y = older[1], dy = newer[1] - y;
  const Double4 z = older[2], dz = newer[2] - z;
  return {x + dx * ratio,    y + dy * ratio,    z + dz * ratio,   wa * ax + wb * bx,
          wa * ay + wb * by, wa * az + wb * bz, wa * aw + wb * bw};
}

}  // namespace ztf
