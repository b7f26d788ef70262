// Four poses computed at once: of four links at one time, or of one link at four times.
//
// Thread safety: values; what is read of samples is as everything about them (frame.hpp).
// Everything is inlined that takes or returns vectors by value: how they are passed depends on
// the processor that a caller is compiled for (ZTF_CLONES).
#pragma once

#include "history.hpp"

namespace ztf {

using NumberQuad = double __attribute__((vector_size(32)));
using BitsQuad = long long __attribute__((vector_size(32)));
using PoseQuad = PoseOf<NumberQuad>;

ZTF_HOT Pose unpacked(const PoseQuad& p, std::size_t i) noexcept {
  return {p.x[i], p.y[i], p.z[i], p.qx[i], p.qy[i], p.qz[i], p.qw[i]};
}

ZTF_HOT NumberQuad swapped(NumberQuad v) noexcept { return NumberQuad{v[1], v[0], v[3], v[2]}; }

// Lane 0: lane 1's pose after lane 0's; lane 2: lane 3's after lane 2's.
ZTF_HOT PoseQuad product_of_pairs(const PoseQuad& p) noexcept {
  return PoseQuad{swapped(p.x),  swapped(p.y),  swapped(p.z), swapped(p.qx),
                  swapped(p.qy), swapped(p.qz), swapped(p.qw)} *
         p;
}

// One sample each of four histories.
struct SampleQuad {
  const Sample &a, &b, &c, &d;

  ZTF_HOT NumberQuad operator[](int i) const noexcept {
    return NumberQuad{a.pose[i], b.pose[i], c.pose[i], d.pose[i]};
  }
};

// How far the times lie between the samples, from 0 to 1: 0 where those are one.
ZTF_HOT NumberQuad shares(const Bracket& a, const Bracket& b, const Bracket& c,
                          const Bracket& d) noexcept {
  const auto acquire = std::memory_order_acquire;
  const Stamp from[4] = {a.older->stamp.load(acquire), b.older->stamp.load(acquire),
                         c.older->stamp.load(acquire), d.older->stamp.load(acquire)};
  const NumberQuad span{distance(from[0], a.newer->stamp.load(acquire)),
                        distance(from[1], b.newer->stamp.load(acquire)),
                        distance(from[2], c.newer->stamp.load(acquire)),
                        distance(from[3], d.newer->stamp.load(acquire))};
  const NumberQuad passed{distance(from[0], a.time), distance(from[1], b.time),
                          distance(from[2], c.time), distance(from[3], d.time)};
  const NumberQuad zero{};
  return span > zero ? passed / span : zero;
}

// Large angles: one after the other.
[[gnu::noinline]] inline PoseQuad interpolate_each(const Bracket* const (&rows)[4],
                                                   const NumberQuad& ratio) noexcept {
  Pose p[4];
  for (std::size_t i = 0; i < 4; ++i)
    p[i] = interpolate(rows[i]->older->pose.load(), rows[i]->newer->pose.load(), ratio[i]);
  const auto component = [&](double Pose::* c) {
    return NumberQuad{p[0].*c, p[1].*c, p[2].*c, p[3].*c};
  };
  return {component(&Pose::x),  component(&Pose::y),  component(&Pose::z), component(&Pose::qx),
          component(&Pose::qy), component(&Pose::qz), component(&Pose::qw)};
}

// The numbers times 1 or -1.
ZTF_HOT NumberQuad with_sign(NumberQuad numbers, BitsQuad sign) noexcept {
  return reinterpret_cast<NumberQuad>(reinterpret_cast<BitsQuad>(numbers) ^ sign);
}

// As interpolate() of each. The rotations first: so fewer values are to be kept at a time.
ZTF_HOT PoseQuad interpolate(const Bracket& a, const Bracket& b, const Bracket& c,
                             const Bracket& d) noexcept {
  const SampleQuad older{*a.older, *b.older, *c.older, *d.older};
  const SampleQuad newer{*a.newer, *b.newer, *c.newer, *d.newer};
  const NumberQuad ratio = shares(a, b, c, d);
  const NumberQuad ax = older[3], bx = newer[3], ay = older[4], by = newer[4];
  const NumberQuad az = older[5], bz = newer[5], aw = older[6], bw = newer[6];
  const NumberQuad dot = (ax * bx + ay * by) + (az * bz + aw * bw);
  constexpr long long kSign = std::numeric_limits<long long>::min();
  const BitsQuad sign = reinterpret_cast<BitsQuad>(dot) & kSign;  // q and -q are one rotation
  const NumberQuad rest = 1.0 - with_sign(dot, sign);
  const double widest = std::max(std::max(rest[0], rest[1]), std::max(rest[2], rest[3]));
  if (!(widest < detail::kClose)) [[unlikely]]
    return interpolate_each({&a, &b, &c, &d}, ratio);
  NumberQuad wa, wb;
  detail::weights_if_close(rest, ratio, wa, wb);
  wb = with_sign(wb, sign);
  const NumberQuad x = older[0], x_way = newer[0] - x;
  const NumberQuad y = older[1], y_way = newer[1] - y;
  const NumberQuad z = older[2], z_way = newer[2] - z;
  return {x + x_way * ratio, y + y_way * ratio, z + z_way * ratio, wa * ax + wb * bx,
          wa * ay + wb * by, wa * az + wb * bz, wa * aw + wb * bw};
}

}  // namespace ztf
