// The one place where poses are multiplied by the million.
//
// On x86-64 a second version with fused multiply-add is chosen when the library
// is loaded.
#include "compose.hpp"

#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
#define ZTF_CLONES __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define ZTF_CLONES
#endif

namespace ztf {

namespace {

// b = a * b; in place, by v + 2 w (q x v) + 2 q x (q x v) for the translation.
ZTF_HOT void multiply(const Pose& a, Pose& b) noexcept {
  const double ux = a.qy * b.z - a.qz * b.y;
  const double uy = a.qz * b.x - a.qx * b.z;
  const double uz = a.qx * b.y - a.qy * b.x;
  const double vx = ux + ux, vy = uy + uy, vz = uz + uz;
  b.x = a.x + b.x + a.qw * vx + a.qy * vz - a.qz * vy;
  b.y = a.y + b.y + a.qw * vy + a.qz * vx - a.qx * vz;
  b.z = a.z + b.z + a.qw * vz + a.qx * vy - a.qy * vx;
  const double qx = b.qx, qy = b.qy, qz = b.qz, qw = b.qw;
  b.qx = a.qw * qx + a.qx * qw + a.qy * qz - a.qz * qy;
  b.qy = a.qw * qy + a.qy * qw + a.qz * qx - a.qx * qz;
  b.qz = a.qw * qz + a.qz * qw + a.qx * qy - a.qy * qx;
  b.qw = a.qw * qw - a.qx * qx - a.qy * qy - a.qz * qz;
}

ZTF_HOT void compose_run(const Step* step, const Step* end, Stamp stamp, Pose& product) noexcept {
  product = step->slot == Place::kNewest ? step->frame->latest_pose.load()
                                         : pose_between(*step->frame, step->slot, stamp);
  while (++step != end) {
    if (step->slot == Place::kNewest) [[likely]]
      multiply(step->frame->latest_pose.load(), product);
    else
      multiply(pose_between(*step->frame, step->slot, stamp), product);
  }
}

}  // namespace

// In two halves that do not wait for each other: the running product is the
// longest chain of dependent operations in a lookup.
ZTF_CLONES
void compose(const Step* steps, std::size_t links, Stamp stamp, Pose& pose) noexcept {
  Pose lower;
  const std::size_t half = links - links / 2;
  compose_run(steps, steps + half, stamp, lower);
  if (links > 1) {
    Pose upper;
    compose_run(steps + half, steps + links, stamp, upper);
    multiply(upper, lower);
  }
  pose = lower;
}

}  // namespace ztf
