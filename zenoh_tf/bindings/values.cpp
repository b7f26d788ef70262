// Transform, StampedTransform and LatestTransform.
#include <cmath>
#include <cstdio>
#include <cstring>

#include "bindings.hpp"

namespace ztf {

namespace {

nb::tuple tuple_of(const double* values, int n) {
  nb::list list;
  for (int i = 0; i < n; ++i) list.append(values[i]);
  return nb::tuple(list);
}

std::string text_of_pose(const Pose& p) {
  char text[256];
  std::snprintf(text, sizeof text,
                "translation=(%.9g, %.9g, %.9g), rotation=(%.9g, %.9g, %.9g, %.9g)", p.x, p.y, p.z,
                p.qx, p.qy, p.qz, p.qw);
  return text;
}

bool equal(const Pose& a, const Pose& b) {
  const double *x = &a.x, *y = &b.x;
  for (int i = 0; i < 7; ++i)
    if (x[i] != y[i]) return false;
  return true;
}

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

Pose pose_from_matrix(nb::handle matrix) {
  nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu> m;
  if (!nb::try_cast(doubles_of(matrix, "matrix"), m))
    raise_invalid("matrix must have the shape (4, 4)", "matrix");
  const auto r = [&](int i, int j) {
    return m(static_cast<std::size_t>(i), static_cast<std::size_t>(j));
  };
  double worst = std::abs(r(3, 3) - 1);
  for (int j = 0; j < 3; ++j) worst = std::max(worst, std::abs(r(3, j)));
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      double dot = i == j ? -1.0 : 0.0;
      for (int k = 0; k < 3; ++k) dot += r(i, k) * r(j, k);
      worst = std::max(worst, std::abs(dot));
    }
  const double det = r(0, 0) * (r(1, 1) * r(2, 2) - r(1, 2) * r(2, 1)) -
                     r(0, 1) * (r(1, 0) * r(2, 2) - r(1, 2) * r(2, 0)) +
                     r(0, 2) * (r(1, 0) * r(2, 1) - r(1, 1) * r(2, 0));
  if (!(worst < 1e-6) || det < 0)
    raise_invalid("matrix is not a rigid transform: a rotation and a last row of 0 0 0 1",
                  "matrix");
  // Shepperd's choice: the largest component first, so that nothing small divides.
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

std::string shown(const StampedTransform& s) {
  return nb::cast<std::string>(nb::repr(s.parent_frame)) + ", " +
         nb::cast<std::string>(nb::repr(s.child_frame)) + ", stamp_ns=" + std::to_string(s.stamp);
}

StampedTransform make_stamped(nb::handle parent, nb::handle child, nb::handle stamp,
                              const Pose& pose) {
  text_of(parent, "parent_frame");
  text_of(child, "child_frame");
  if (stamp.is_none()) raise_invalid("stamp_ns must be an int of nanoseconds", "stamp_ns");
  return {nb::borrow(parent), nb::borrow(child), stamp_of(stamp, "stamp_ns"), pose};
}

bool equal(const StampedTransform& a, const StampedTransform& b) {
  return a.stamp == b.stamp && equal(a.pose, b.pose) && a.parent_frame.equal(b.parent_frame) &&
         a.child_frame.equal(b.child_frame);
}

}  // namespace

// Pooled: lookups make such values all the time, and most are soon dropped.
void bind_values(nb::module_& m) {
  nb::class_<Pose> transform(
      m, "Transform", nb::pooled(),
      "A rigid transform: rotation, then translation. As `X_parent_child` it is the\n"
      "pose of child in parent and maps coordinates in child to coordinates in parent.\n"
      "Immutable. Metres; quaternions (x, y, z, w), expected to be of unit length:\n"
      "checked where a transform is set in a tree, not here.");
  transform
      .def(
          "__init__",
          [](Pose* self, nb::handle translation, nb::handle rotation) {
            new (self) Pose(pose_of(translation, rotation));
          },
          nb::arg("translation").none() = nb::make_tuple(0.0, 0.0, 0.0),
          nb::arg("rotation").none() = nb::make_tuple(0.0, 0.0, 0.0, 1.0))
      .def_static(
          "identity", [] { return Pose{}; }, "The transform that changes nothing.")
      .def_static(
          "from_pose",
          [](nb::handle pose) {
            Pose p;
            numbers_of(pose, &p.x, 7, "pose");
            return p;
          },
          nb::arg("pose").none(), "From x, y, z, qx, qy, qz, qw: what `pose()` gives.")
      .def_static(
          "from_matrix", &pose_from_matrix, nb::arg("matrix").none(),
          "From a (4, 4) homogeneous matrix. `InvalidArgumentException` if it is not rigid.")
      .def_prop_ro(
          "translation",
          [](const Pose& p) {
            return make_array<double>({3}, [&](double* d) { std::memcpy(d, &p.x, 24); });
          },
          "(3,) float64, metres.")
      .def_prop_ro(
          "rotation",
          [](const Pose& p) {
            return make_array<double>({4}, [&](double* d) { std::memcpy(d, &p.qx, 32); });
          },
          "(4,) float64, quaternion (x, y, z, w).")
      .def(
          "pose", [](const Pose& p) { return tuple_of(&p.x, 7); },
          "(x, y, z, qx, qy, qz, qw) as Python floats.")
      .def(
          "matrix",
          [](const Pose& p) {
            return make_array<double>({4, 4}, [&](double* d) { matrix_of(p, d); });
          },
          "(4, 4) float64, homogeneous.")
      .def(
          "inverse", [](const Pose& p) { return inverse(p); }, "`X_ba` from `X_ab`.")
      .def(
          "__matmul__", [](const Pose& a, const Pose& b) { return a * b; }, nb::is_operator(),
          "`X_ac = X_ab @ X_bc`")
      .def(
          "__eq__", [](const Pose& a, const Pose& b) { return equal(a, b); }, nb::is_operator())
      .def("__hash__", [](const Pose& p) { return nb::hash(tuple_of(&p.x, 7)); })
      .def("__repr__", [](const Pose& p) { return "Transform(" + text_of_pose(p) + ")"; })
      .def("__reduce__", [](nb::handle self) {
        const Pose& p = nb::cast<const Pose&>(self);
        return nb::make_tuple(self.type(), nb::make_tuple(tuple_of(&p.x, 3), tuple_of(&p.qx, 4)));
      });
  bind_apply(transform);

  nb::class_<StampedTransform>(
      m, "StampedTransform", nb::pooled(),
      "The pose of `child_frame` in `parent_frame` at `stamp_ns`. Immutable.")
      .def(
          "__init__",
          [](StampedTransform* self, nb::handle parent, nb::handle child, nb::handle stamp,
             const Pose& transform) {
            new (self) StampedTransform(make_stamped(parent, child, stamp, transform));
          },
          nb::arg("parent_frame"), nb::arg("child_frame"), nb::arg("stamp_ns").none(),
          nb::arg("transform"))
      .def_prop_ro("parent_frame", [](const StampedTransform& s) { return s.parent_frame; })
      .def_prop_ro("child_frame", [](const StampedTransform& s) { return s.child_frame; })
      .def_prop_ro("stamp_ns", [](const StampedTransform& s) { return s.stamp; })
      .def_prop_ro("transform", [](const StampedTransform& s) { return s.pose; })
      .def(
          "__eq__",
          [](const StampedTransform& a, const StampedTransform& b) { return equal(a, b); },
          nb::is_operator())
      .def("__hash__",
           [](const StampedTransform& s) {
             return nb::hash(
                 nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, tuple_of(&s.pose.x, 7)));
           })
      .def("__repr__",
           [](const StampedTransform& s) {
             return "StampedTransform(" + shown(s) + ", " + text_of_pose(s.pose) + ")";
           })
      .def("__reduce__", [](nb::handle self) {
        const auto& s = nb::cast<const StampedTransform&>(self);
        return nb::make_tuple(self.type(),
                              nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, s.pose));
      });

  nb::class_<LatestTransform, StampedTransform>(
      m, "LatestTransform", nb::pooled(),
      "Of the newest of every link: `stamp_ns` is the oldest stamp used, `newest_stamp_ns` the\n"
      "newest. Static links do not count; where all are static, both are 0.")
      .def(
          "__init__",
          [](LatestTransform* self, nb::handle parent, nb::handle child, nb::handle stamp,
             const Pose& transform, Stamp newest) {
            new (self) LatestTransform{make_stamped(parent, child, stamp, transform), newest};
          },
          nb::arg("parent_frame"), nb::arg("child_frame"), nb::arg("stamp_ns"),
          nb::arg("transform"), nb::arg("newest_stamp_ns"))
      .def_prop_ro("newest_stamp_ns", [](const LatestTransform& s) { return s.newest; })
      .def(
          "__eq__",
          [](const LatestTransform& a, const LatestTransform& b) {
            return equal(a, b) && a.newest == b.newest;
          },
          nb::is_operator())
      .def("__hash__",
           [](const LatestTransform& s) {
             return nb::hash(nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, s.newest));
           })
      .def("__repr__",
           [](const LatestTransform& s) {
             return "LatestTransform(" + shown(s) +
                    ", newest_stamp_ns=" + std::to_string(s.newest) + ", " + text_of_pose(s.pose) +
                    ")";
           })
      .def("__reduce__", [](nb::handle self) {
        const auto& s = nb::cast<const LatestTransform&>(self);
        return nb::make_tuple(
            self.type(), nb::make_tuple(s.parent_frame, s.child_frame, s.stamp, s.pose, s.newest));
      });
}

}  // namespace ztf
