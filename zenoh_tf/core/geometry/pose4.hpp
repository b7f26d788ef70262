// Four poses computed at once: of four links at one time, or of one link at four times.
//
// Thread safety: values.
// Invariant: all functions with vector arguments or results are inlined, because the calling
// convention depends on the processor that the caller is compiled for (ZTF_MULTIVERSION).
#pragma once

#include "geometry/pose.hpp"

namespace ztf {

using Double4 = double __attribute__((vector_size(32)));
using Int4 = long long __attribute__((vector_size(32)));
using Pose4 = PoseOf<Double4>;

ZTF_ALWAYS_INLINE Pose lane(const Pose4& p, std::size_t i) noexcept {
  return {p.x[i], p.y[i], p.z[i], p.qx[i], p.qy[i], p.qz[i], p.qw[i]};
}

ZTF_ALWAYS_INLINE double largest(Double4 v) noexcept {
  return std::max(std::max(v[0], v[1]), std::max(v[2], v[3]));
}

// Flips the sign of the numbers whose sign bit is set in `sign`.
ZTF_ALWAYS_INLINE Double4 flip_sign(Double4 numbers, Int4 sign) noexcept {
  return reinterpret_cast<Double4>(reinterpret_cast<Int4>(numbers) ^ sign);
}

}  // namespace ztf
