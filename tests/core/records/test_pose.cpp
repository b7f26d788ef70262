// Pose arithmetic: the group laws, and interpolation against slerp in long double.
#include <random>

#include "fixture.hpp"

using namespace ztf;

namespace {

std::mt19937_64 generator(20240917);

Pose random_pose(double angle_scale = 1) {
  std::normal_distribution<double> normal;
  Pose p{10 * normal(generator),
         10 * normal(generator),
         10 * normal(generator),
         angle_scale * normal(generator),
         angle_scale * normal(generator),
         angle_scale * normal(generator),
         angle_scale == 1 ? normal(generator) : 1};
  const double scale = 1 / std::sqrt(p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw);
  p.qx *= scale;
  p.qy *= scale;
  p.qz *= scale;
  p.qw *= scale;
  return p;
}

Pose negated(Pose p) {
  p.qx = -p.qx;
  p.qy = -p.qy;
  p.qz = -p.qz;
  p.qw = -p.qw;
  return p;
}

// Slerp as in the books: angle by arc cosine (by arc sine of the chord where that is exact), sines.
Pose slerp(const Pose& a, const Pose& b, double ratio) {
  using Real = long double;
  Real qa[4] = {a.qx, a.qy, a.qz, a.qw}, qb[4] = {b.qx, b.qy, b.qz, b.qw};
  Real na = 0, nb = 0, dot = 0, chord = 0;
  for (int i = 0; i < 4; ++i) {
    na += qa[i] * qa[i];
    nb += qb[i] * qb[i];
  }
  for (int i = 0; i < 4; ++i) {
    qa[i] /= std::sqrt(na);
    qb[i] /= std::sqrt(nb);
    dot += qa[i] * qb[i];
  }
  for (int i = 0; i < 4; ++i) {
    if (dot < 0) qb[i] = -qb[i];
    chord += (qa[i] - qb[i]) * (qa[i] - qb[i]);
  }
  const Real t = ratio;
  const Real h =
      std::abs(dot) < 0.9L ? std::acos(std::abs(dot)) : 2 * std::asin(std::sqrt(chord) / 2);
  const Real wa = h < 1e-15L ? 1 - t : std::sin((1 - t) * h) / std::sin(h);
  const Real wb = h < 1e-15L ? t : std::sin(t * h) / std::sin(h);
  Real q[4];
  for (int i = 0; i < 4; ++i) q[i] = wa * qa[i] + wb * qb[i];
  const auto mix = [&](Real x, Real y) { return static_cast<double>(x + (y - x) * t); };
  return {mix(a.x, b.x),
          mix(a.y, b.y),
          mix(a.z, b.z),
          static_cast<double>(q[0]),
          static_cast<double>(q[1]),
          static_cast<double>(q[2]),
          static_cast<double>(q[3])};
}

// `from`, turned by an angle about a random axis and moved.
Pose turned(const Pose& from, double angle) {
  Pose axis = random_pose();
  const double norm = std::sqrt(axis.qx * axis.qx + axis.qy * axis.qy + axis.qz * axis.qz);
  const double s = std::sin(angle / 2) / norm;
  return from *
         Pose{axis.x, axis.y, axis.z, axis.qx * s, axis.qy * s, axis.qz * s, std::cos(angle / 2)};
}

}  // namespace

TEST(inverse_undoes) {
  for (int i = 0; i < 1000; ++i) {
    const Pose p = random_pose();
    CHECK_NEAR(distance(p * inverse(p), Pose{}), 0, 1e-13);
    CHECK_NEAR(distance(inverse(p) * p, Pose{}), 0, 1e-13);
    CHECK_NEAR(distance(inverse(inverse(p)), p), 0, 1e-13);
  }
}

TEST(product_is_associative_and_inverts_in_reverse) {
  for (int i = 0; i < 1000; ++i) {
    const Pose a = random_pose(), b = random_pose(), c = random_pose();
    CHECK_NEAR(distance((a * b) * c, a * (b * c)), 0, 1e-13);
    CHECK_NEAR(distance(inverse(a * b), inverse(b) * inverse(a)), 0, 1e-13);
    CHECK_NEAR(distance(a * Pose{}, a), 0, 0);
    CHECK_NEAR(distance(Pose{} * a, a), 0, 0);
  }
}

TEST(product_is_that_of_matrices) {
  for (int i = 0; i < 100; ++i) {
    const Pose a = random_pose(), b = random_pose(), ab = a * b;
    const double m[3][3] = {{1 - 2 * (a.qy * a.qy + a.qz * a.qz), 2 * (a.qx * a.qy - a.qz * a.qw),
                             2 * (a.qx * a.qz + a.qy * a.qw)},
                            {2 * (a.qx * a.qy + a.qz * a.qw), 1 - 2 * (a.qx * a.qx + a.qz * a.qz),
                             2 * (a.qy * a.qz - a.qx * a.qw)},
                            {2 * (a.qx * a.qz - a.qy * a.qw), 2 * (a.qy * a.qz + a.qx * a.qw),
                             1 - 2 * (a.qx * a.qx + a.qy * a.qy)}};
    const double v[3] = {b.x, b.y, b.z}, t[3] = {a.x, a.y, a.z}, got[3] = {ab.x, ab.y, ab.z};
    for (int r = 0; r < 3; ++r)
      CHECK_NEAR(got[r], t[r] + m[r][0] * v[0] + m[r][1] * v[1] + m[r][2] * v[2], 1e-12);
    CHECK_NEAR(ab.qx * ab.qx + ab.qy * ab.qy + ab.qz * ab.qz + ab.qw * ab.qw, 1, 1e-14);
  }
}

TEST(near_the_identity_nothing_is_lost) {
  for (const double scale : {1e-3, 1e-8, 1e-12, 1e-160, 1e-310, 0.0}) {
    const Pose p = random_pose(scale), q = random_pose(scale);
    CHECK_NEAR((p * q).qx, p.qx + q.qx, 3 * scale * scale + 1e-16 * scale);
    CHECK_NEAR(distance(p * inverse(p), Pose{}), 0, 1e-13);
    for (const double ratio : {0.0, 0.3, 1.0})
      CHECK_NEAR(distance(interpolate(p, q, ratio), slerp(p, q, ratio)), 0, 1e-14 * 100);
  }
}

TEST(interpolation_is_slerp_for_every_angle) {
  const double pi = std::acos(-1.0);
  for (int i = 0; i < 20000; ++i) {
    // Half of them small, over many magnitudes; 2 * acos(0.995) is where the method changes.
    double angle = std::uniform_real_distribution<double>(0, 2 * pi)(generator);
    if (i % 2) angle = std::pow(10, std::uniform_real_distribution<double>(-14, 0)(generator));
    if (i % 10 == 0) angle = 2 * std::acos(0.995) + 1e-3 * (angle - 3);
    if (std::abs(angle - pi) < 1e-6) continue;  // there both arcs are as short
    const double ratio = std::uniform_real_distribution<double>(0, 1)(generator);
    const Pose a = random_pose(), b = turned(a, angle);
    CHECK_NEAR(distance(interpolate(a, b, ratio), slerp(a, b, ratio)), 0, 1e-12);
  }
}

TEST(interpolation_keeps_ends_and_unit_length) {
  for (const double angle :
       {0.0, 1e-9, 1e-3, 0.19, 0.2, 0.21, 1.0, 3.0, 3.14159265358979, 4.0, 6.28}) {
    const Pose a = random_pose(), b = turned(a, angle);
    CHECK_NEAR(distance(interpolate(a, b, 0), a), 0, 1e-14);
    CHECK_NEAR(distance(interpolate(a, b, 1), b), 0, 1e-13);
    const Pose m = interpolate(a, b, 0.5);
    CHECK_NEAR(m.qx * m.qx + m.qy * m.qy + m.qz * m.qz + m.qw * m.qw, 1, 1e-13);
    const auto dot = [&](const Pose& p) {
      return m.qx * p.qx + m.qy * p.qy + m.qz * p.qz + m.qw * p.qw;
    };
    CHECK_NEAR(std::abs(dot(a)), std::abs(dot(b)), 1e-13);  // as far from both
  }
}

TEST(a_quaternion_and_its_negative_are_one_rotation) {
  for (int i = 0; i < 1000; ++i) {
    const Pose a = random_pose(), b = turned(a, i % 2 ? 1e-3 : 2.0), c = random_pose();
    const double ratio = i / 1000.0;
    const Pose expected = interpolate(a, b, ratio);
    CHECK_NEAR(distance(interpolate(a, negated(b), ratio), expected), 0, 1e-14);
    CHECK_NEAR(distance(interpolate(negated(a), b, ratio), expected), 0, 1e-14);
    CHECK_NEAR(distance(negated(a) * c, a * c), 0, 1e-13);
    CHECK_NEAR(distance(inverse(negated(a)), inverse(a)), 0, 1e-13);
  }
}
