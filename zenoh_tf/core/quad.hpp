// Four poses computed at once: of four links at one time, or of one link at four times.
//
// Thread safety: values; what is read of samples is as everything about them (frame.hpp).
#pragma once

#include "history.hpp"

namespace ztf {

using NumberQuad = double __attribute__((vector_size(32)));
using PoseQuad = PoseOf<NumberQuad>;

ZTF_HOT Pose unpacked(const PoseQuad& p, std::size_t i) noexcept {
  return {p.x[i], p.y[i], p.z[i], p.qx[i], p.qy[i], p.qz[i], p.qw[i]};
}

ZTF_HOT PoseQuad packed(const SharedPose& a, const SharedPose& b, const SharedPose& c,
                        const SharedPose& d) noexcept {
  const auto component = [&](int i) { return NumberQuad{a[i], b[i], c[i], d[i]}; };
  return {component(0), component(1), component(2), component(3),
          component(4), component(5), component(6)};
}

// Large angles: one after the other.
[[gnu::noinline]] inline PoseQuad interpolate_each(const Between (&rows)[4]) noexcept {
  Pose p[4];
  for (std::size_t i = 0; i < 4; ++i)
    p[i] = interpolate(rows[i].older->load(), rows[i].newer->load(), rows[i].ratio);
  const auto component = [&](double Pose::* c) {
    return NumberQuad{p[0].*c, p[1].*c, p[2].*c, p[3].*c};
  };
  return {component(&Pose::x),  component(&Pose::y),  component(&Pose::z), component(&Pose::qx),
          component(&Pose::qy), component(&Pose::qz), component(&Pose::qw)};
}

// As interpolate() of each.
ZTF_HOT PoseQuad interpolate(const Between (&rows)[4]) noexcept {
  const PoseQuad a = packed(*rows[0].older, *rows[1].older, *rows[2].older, *rows[3].older);
  const PoseQuad b = packed(*rows[0].newer, *rows[1].newer, *rows[2].newer, *rows[3].newer);
  const NumberQuad ratio{rows[0].ratio, rows[1].ratio, rows[2].ratio, rows[3].ratio};
  const NumberQuad dot = detail::dot(a, b);
  const NumberQuad zero{}, one = zero + 1.0;
  const NumberQuad sign = dot < zero ? -one : one;
  const NumberQuad rest = one - (dot * sign > one ? one : dot * sign);
  const double widest = std::max(std::max(rest[0], rest[1]), std::max(rest[2], rest[3]));
  if (!(widest < detail::kClose)) [[unlikely]]
    return interpolate_each(rows);
  NumberQuad wa, wb;
  detail::weights_if_close(rest, ratio, wa, wb);
  return detail::mix(a, b, ratio, wa, wb * sign);
}

}  // namespace ztf
