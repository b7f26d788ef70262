// Four poses computed at once: of four links at one time, or of one link at four times.
//
// Thread safety: values; what is read of samples is as everything about them (frame.hpp).
// Everything is inlined that takes or returns vectors by value: how they are passed depends on
// the processor that a caller is compiled for (ZTF_MULTIVERSION).
#pragma once

#include "history.hpp"

namespace ztf {

using Double4 = double __attribute__((vector_size(32)));
using Int4 = long long __attribute__((vector_size(32)));
using Pose4 = PoseOf<Double4>;

ZTF_ALWAYS_INLINE Pose lane(const Pose4& p, std::size_t i) noexcept {
  return {p.x[i], p.y[i], p.z[i], p.qx[i], p.qy[i], p.qz[i], p.qw[i]};
}

ZTF_ALWAYS_INLINE Double4 swap_pairs(Double4 v) noexcept { return Double4{v[1], v[0], v[3], v[2]}; }

// Lane 0: lane 1's pose after lane 0's; lane 2: lane 3's after lane 2's.
ZTF_ALWAYS_INLINE Pose4 product_of_pairs(const Pose4& p) noexcept {
  return Pose4{swap_pairs(p.x),  swap_pairs(p.y),  swap_pairs(p.z), swap_pairs(p.qx),
               swap_pairs(p.qy), swap_pairs(p.qz), swap_pairs(p.qw)} *
         p;
}

// One sample each of four histories.
struct Sample4 {
  const Sample &a, &b, &c, &d;

  ZTF_ALWAYS_INLINE Double4 operator[](int i) const noexcept {
    return Double4{a.pose[i], b.pose[i], c.pose[i], d.pose[i]};
  }
};

// How far the times lie between the samples, from 0 to 1: 0 where those are one.
ZTF_ALWAYS_INLINE Double4 interpolation_ratios(const SampleInterval& a, const SampleInterval& b,
                                               const SampleInterval& c,
                                               const SampleInterval& d) noexcept {
  const auto acquire = std::memory_order_acquire;
  const Stamp from[4] = {a.older->stamp.load(acquire), b.older->stamp.load(acquire),
                         c.older->stamp.load(acquire), d.older->stamp.load(acquire)};
  const Double4 span{distance(from[0], a.newer->stamp.load(acquire)),
                     distance(from[1], b.newer->stamp.load(acquire)),
                     distance(from[2], c.newer->stamp.load(acquire)),
                     distance(from[3], d.newer->stamp.load(acquire))};
  const Double4 passed{distance(from[0], a.time), distance(from[1], b.time),
                       distance(from[2], c.time), distance(from[3], d.time)};
  const Double4 zero{};
  return span > zero ? passed / span : zero;
}

// Large angles: one after the other.
[[gnu::noinline]] inline Pose4 interpolate_each(const SampleInterval* const (&rows)[4],
                                                const Double4& ratio) noexcept {
  Pose p[4];
  for (std::size_t i = 0; i < 4; ++i)
    p[i] = interpolate(rows[i]->older->pose.load(), rows[i]->newer->pose.load(), ratio[i]);
  const auto component = [&](double Pose::* c) {
    return Double4{p[0].*c, p[1].*c, p[2].*c, p[3].*c};
  };
  return {component(&Pose::x),  component(&Pose::y),  component(&Pose::z), component(&Pose::qx),
          component(&Pose::qy), component(&Pose::qz), component(&Pose::qw)};
}

// The numbers times 1 or -1.
ZTF_ALWAYS_INLINE Double4 with_sign(Double4 numbers, Int4 sign) noexcept {
  return reinterpret_cast<Double4>(reinterpret_cast<Int4>(numbers) ^ sign);
}

// As interpolate() of each. The rotations first: so fewer values are to be kept at a time.
ZTF_ALWAYS_INLINE Pose4 interpolate(const SampleInterval& a, const SampleInterval& b,
                                    const SampleInterval& c, const SampleInterval& d) noexcept {
  const Sample4 older{*a.older, *b.older, *c.older, *d.older};
  const Sample4 newer{*a.newer, *b.newer, *c.newer, *d.newer};
  const Double4 ratio = interpolation_ratios(a, b, c, d);
  const Double4 ax = older[3], bx = newer[3], ay = older[4], by = newer[4];
  const Double4 az = older[5], bz = newer[5], aw = older[6], bw = newer[6];
  const Double4 dot = (ax * bx + ay * by) + (az * bz + aw * bw);
  constexpr long long kSign = std::numeric_limits<long long>::min();
  const Int4 sign = reinterpret_cast<Int4>(dot) & kSign;  // q and -q are one rotation
  const Double4 rest = 1.0 - with_sign(dot, sign);
  const double widest = std::max(std::max(rest[0], rest[1]), std::max(rest[2], rest[3]));
  if (!(widest < detail::kClose)) [[unlikely]]
    return interpolate_each({&a, &b, &c, &d}, ratio);
  Double4 wa, wb;
  detail::weights_if_close(rest, ratio, wa, wb);
  wb = with_sign(wb, sign);
  const Double4 x = older[0], x_way = newer[0] - x;
  const Double4 y = older[1], y_way = newer[1] - y;
  const Double4 z = older[2], z_way = newer[2] - z;
  return {x + x_way * ratio, y + y_way * ratio, z + z_way * ratio, wa * ax + wb * bx,
          wa * ay + wb * by, wa * az + wb * bz, wa * aw + wb * bw};
}

}  // namespace ztf
