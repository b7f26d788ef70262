// Transform: a pose as a Python value.
#include "bindings/transforms/transform.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

namespace ztf {

nb::tuple numbers(const double* values, int n) {
  nb::list list;
  for (int i = 0; i < n; ++i) list.append(values[i]);
  return nb::tuple(list);
}

// Python's shortest digits that give the same doubles, so that eval() restores the value.
std::string repr_of(const Pose& p) {
  const auto text = [](const nb::tuple& t) { return nb::cast<std::string>(nb::repr(t)); };
  return "Transform(translation=" + text(numbers(&p.x, 3)) +
         ", rotation=" + text(numbers(&p.qx, 4)) + ")";
}

namespace {

// Entries of a rigid matrix may be off by this much.
constexpr double kRigidTolerance = 1e-6;
// At a pitch this close to +-pi/2, which is a rounding error, only roll + yaw or roll - yaw is
// determined.
constexpr double kGimbalLock = 1e-15;

bool equal(const Pose& a, const Pose& b) { return std::equal(&a.x, &a.x + 7, &b.x); }

void matrix_of(const Pose& p, double* m) {
  const double x = p.qx, y = p.qy, z = p.qz, w = p.qw;
  const double rows[16] = {1 - 2 * (y * y + z * z),
                           2 * (x * y - w * z),
                           2 * (x * z + w * y),
                           p.x,
                           2 * (x * y + w * z),
                           1 - 2 * (x * x + z * z),
                           2 * (y * z - w * x),
                           p.y,
                           2 * (x * z - w * y),
                           2 * (y * z + w * x),
                           1 - 2 * (x * x + y * y),
                           p.z,
                           0,
                           0,
                           0,
                           1};
  std::memcpy(m, rows, sizeof rows);
}

using Matrix = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;

// How far the matrix is from a rigid transform, 0 for one that is; infinity for a reflection.
template <class Element>
double rigid_error(const Element& r) {
  double worst = std::abs(r(3, 3) - 1);
  for (int j = 0; j < 3; ++j) worst = std::max(worst, std::abs(r(3, j)));
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      double dot = i == j ? -1.0 : 0.0;
      for (int k = 0; k < 3; ++k) dot += r(i, k) * r(j, k);
      worst = std::max(worst, std::abs(dot));
      if (!std::isfinite(dot)) return std::numeric_limits<double>::infinity();
    }
  const double det = r(0, 0) * (r(1, 1) * r(2, 2) - r(1, 2) * r(2, 1)) -
                     r(0, 1) * (r(1, 0) * r(2, 2) - r(1, 2) * r(2, 0)) +
                     r(0, 2) * (r(1, 0) * r(2, 1) - r(1, 1) * r(2, 0));
  return det < 0 ? std::numeric_limits<double>::infinity() : worst;
}

Pose from_matrix(nb::handle matrix) {
  Matrix m;
  if (!nb::try_cast(doubles_of(matrix, "matrix"), m))
    raise_invalid("matrix must have the shape (4, 4)", "matrix");
  const auto r = [&](int i, int j) {
    return m(static_cast<std::size_t>(i), static_cast<std::size_t>(j));
  };
  if (!(rigid_error(r) < kRigidTolerance))
    raise_invalid(
        "matrix is not rigid: it must be a rotation matrix and a translation above a "
        "last row of 0 0 0 1, within 1e-6",
        "matrix");
  // Shepperd's method: solve for the largest component first, so that no divisor is small.
  Pose p{r(0, 3), r(1, 3), r(2, 3), 0, 0, 0, 1};
  const double trace = r(0, 0) + r(1, 1) + r(2, 2);
  if (trace > 0) {
    const double s = 2 * std::sqrt(1 + trace);
    p.qw = s / 4;
    p.qx = (r(2, 1) - r(1, 2)) / s;
    p.qy = (r(0, 2) - r(2, 0)) / s;
    p.qz = (r(1, 0) - r(0, 1)) / s;
  } else {
    int i = r(1, 1) > r(0, 0) ? 1 : 0;
    if (r(2, 2) > r(i, i)) i = 2;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const double s = 2 * std::sqrt(1 + r(i, i) - r(j, j) - r(k, k));
    double* q = &p.qx;
    q[i] = s / 4;
    p.qw = (r(k, j) - r(j, k)) / s;
    q[j] = (r(j, i) + r(i, j)) / s;
    q[k] = (r(k, i) + r(i, k)) / s;
  }
  const double scale = 1 / std::sqrt(p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw);
  p.qx *= scale;
  p.qy *= scale;
  p.qz *= scale;
  p.qw *= scale;
  return p;
}

Pose from_pose(nb::handle pose) {
  Pose p;
  numbers_of(pose, &p.x, 7, "pose");
  return p;
}

// Rz(yaw) Ry(pitch) Rx(roll).
Pose from_rpy(double roll, double pitch, double yaw, nb::handle translation, bool degrees) {
  if (degrees)
    for (double* angle : {&roll, &pitch, &yaw}) *angle *= std::numbers::pi / 180;
  Pose p;
  numbers_of(translation, &p.x, 3, "translation");
  const double sr = std::sin(roll / 2), cr = std::cos(roll / 2);
  const double sp = std::sin(pitch / 2), cp = std::cos(pitch / 2);
  const double sy = std::sin(yaw / 2), cy = std::cos(yaw / 2);
  p.qx = sr * cp * cy - cr * sp * sy;
  p.qy = cr * sp * cy + sr * cp * sy;
  p.qz = cr * cp * sy - sr * sp * cy;
  p.qw = cr * cp * cy + sr * sp * sy;
  return p;
}

// With half angles r, p, y of roll, pitch, yaw:
//   qx + qz = (cos p - sin p) sin(y + r)    qw - qy = (cos p - sin p) cos(y + r)
//   qz - qx = (cos p + sin p) sin(y - r)    qw + qy = (cos p + sin p) cos(y - r)
// Unlike the arc sine of a matrix entry this loses no digits near a pitch of +-pi/2.
nb::tuple rpy(const Pose& p) {
  const double minus = std::hypot(p.qx + p.qz, p.qw - p.qy);  // sqrt(2) cos(p + pi/4)
  const double plus = std::hypot(p.qz - p.qx, p.qw + p.qy);   // sqrt(2) sin(p + pi/4)
  double sum = std::atan2(p.qx + p.qz, p.qw - p.qy);
  double difference = std::atan2(p.qz - p.qx, p.qw + p.qy);
  if (minus < kGimbalLock * plus) sum = difference;  // choose a roll of 0
  if (plus < kGimbalLock * minus) difference = sum;
  constexpr double pi = std::numbers::pi;
  return nb::make_tuple(std::remainder(sum - difference, 2 * pi),
                        2 * std::atan2(plus, minus) - pi / 2,
                        std::remainder(sum + difference, 2 * pi));
}

nb::object matrix(const Pose& p) {
  return make_array<double>({4, 4}, [&](double* d) { matrix_of(p, d); });
}

// NumPy's protocol: numpy.asarray(X) is the matrix.
nb::object as_array(const Pose& p, nb::handle dtype, nb::handle copy) {
  if (copy.is(nb::handle(Py_False)))
    throw nb::value_error("a Transform gives no array without a copy");
  const nb::object found = matrix(p);
  return dtype.is_none() ? found : found.attr("astype")(dtype);
}

Pose product(const Pose& a, const Pose& b) { return a * b; }

void bind_constructors(nb::class_<Pose>& transform) {
  transform.def_static(
               "identity", [] { return Pose{}; }, ZTF_DOC(Transform_identity))
      .def_static("from_pose", &from_pose, ZTF_DOC(Transform_from_pose), nb::arg("pose").none())
      .def_static("from_matrix", &from_matrix, ZTF_DOC(Transform_from_matrix),
                  nb::arg("matrix").none())
      .def_static("from_rpy", &from_rpy, ZTF_DOC(Transform_from_rpy), nb::arg("roll"),
                  nb::arg("pitch"), nb::arg("yaw"),
                  nb::arg("translation").none() = nb::make_tuple(0.0, 0.0, 0.0), nb::kw_only(),
                  nb::arg("degrees") = false);
}

// A new array of some numbers. Read-only: a user who writes to it expects the transform to change.
nb::object read_only(const double* values, std::size_t n) {
  auto storage = std::make_unique_for_overwrite<double[]>(n);
  std::copy_n(values, n, storage.get());
  const double* const data = storage.get();
  nb::capsule owner(storage.release(), [](void* p) noexcept { delete[] static_cast<double*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, const double>(data, {n}, owner));
}

void bind_parts(nb::class_<Pose>& transform) {
  transform
      .def_prop_ro(
          "translation", [](const Pose& p) { return read_only(&p.x, 3); },
          ZTF_PROPERTY_DOC(Transform_translation))
      .def_prop_ro(
          "rotation", [](const Pose& p) { return read_only(&p.qx, 4); },
          ZTF_PROPERTY_DOC(Transform_rotation))
      .def(
          "pose", [](const Pose& p) { return numbers(&p.x, 7); }, ZTF_DOC(Transform_pose))
      .def("rpy", &rpy, ZTF_DOC(Transform_rpy))
      .def("__array__", &as_array, ZTF_DOC(Transform_array), nb::arg("dtype") = nb::none(),
           nb::arg("copy") = nb::none())
      .def("matrix", &matrix, ZTF_DOC(Transform_matrix))
      .def("inverse", [](const Pose& p) { return inverse(p); }, ZTF_DOC(Transform_inverse));
}

}  // namespace

void bind_transform(nb::module_& m) {
  // Pooled, since lookups create many of these for a short time.
  nb::class_<Pose> transform(m, "Transform", nb::pooled(), docs::Transform.text);
  transform.def(
      "__init__",
      [](Pose* self, nb::handle translation, nb::handle rotation) {
        new (self) Pose(pose_of(translation, rotation));
      },
      nb::arg("translation").none() = nb::make_tuple(0.0, 0.0, 0.0),
      nb::arg("rotation").none() = nb::make_tuple(0.0, 0.0, 0.0, 1.0));
  bind_constructors(transform);
  bind_parts(transform);
  bind_apply(transform);
  transform.def("__matmul__", &product, ZTF_DOC(Transform_matmul), nb::is_operator())
      .def(
          "__eq__", [](const Pose& a, const Pose& b) { return equal(a, b); }, nb::is_operator())
      .def("__hash__", [](const Pose& p) { return nb::hash(numbers(&p.x, 7)); })
      .def("__repr__", &repr_of)
      .def("__reduce__", [](nb::handle self) {
        const Pose& p = nb::cast<const Pose&>(self);
        return nb::make_tuple(self.type(), nb::make_tuple(numbers(&p.x, 3), numbers(&p.qx, 4)));
      });
}

}  // namespace ztf
