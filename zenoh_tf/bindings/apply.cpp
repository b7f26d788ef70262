// Transform's apply methods: points, vectors, poses, covariances, wrenches and
// twists that are given in child, expressed in parent.
//
// Interpreter lock: long arrays release it.
#include "bindings.hpp"

namespace ztf {

namespace {

// Below this many numbers (some 10 us of work) other threads gain less from the
// interpreter lock than handing it over and getting it back costs.
constexpr std::size_t kReleaseFrom = 10'000;

// (..., *Tail) -> a new array of the same shape, made one item at a time.
template <std::size_t... Tail, class Item>
nb::object map_items(nb::handle values, const char* field, Item item) {
  constexpr std::size_t step = (Tail * ...);  // numbers in an item
  const nb::object array = doubles_of(values, field);
  const auto in = nb::cast<nb::ndarray<const double, nb::c_contig, nb::device::cpu>>(array);
  bool fits = in.ndim() >= sizeof...(Tail);
  std::size_t axis = in.ndim() - sizeof...(Tail);
  ((fits = fits && in.shape(axis++) == Tail), ...);
  if (!fits)
    raise_invalid(
        (std::string(field) + " must have the shape (..." + ... + (", " + std::to_string(Tail))) +
            ")",
        field);
  const nb::object result = nb::module_::import_("numpy").attr("empty_like")(array);
  const auto out = nb::cast<nb::ndarray<double, nb::c_contig, nb::device::cpu>>(result);
  const double* from = in.data();
  double* to = out.data();
  const std::size_t size = in.size();
  std::optional<nb::gil_scoped_release> release;
  if (size >= kReleaseFrom) release.emplace();
  for (std::size_t i = 0; i < size; i += step) item(from + i, to + i);
  release.reset();
  return result;
}

Vec3 rotate(const Pose& pose, const double* v) { return rotate(pose, v[0], v[1], v[2]); }

// t x v, with the pose's translation as t: what the lever arm adds.
Vec3 lever(const Pose& pose, const Vec3& v) {
  return {pose.y * v.z - pose.z * v.y,  //
          pose.z * v.x - pose.x * v.z,  //
          pose.x * v.y - pose.y * v.x};
}

void put(double* to, const Vec3& v) {
  to[0] = v.x;
  to[1] = v.y;
  to[2] = v.z;
}

void put_sum(double* to, const Vec3& a, const Vec3& b) {
  put(to, {a.x + b.x, a.y + b.y, a.z + b.z});
}

nb::object apply_points(const Pose& pose, nb::handle points) {
  return map_items<3>(points, "points", [pose](const double* p, double* out) {
    put_sum(out, {pose.x, pose.y, pose.z}, rotate(pose, p));
  });
}

nb::object apply_vectors(const Pose& pose, nb::handle vectors) {
  return map_items<3>(vectors, "vectors",
                      [pose](const double* v, double* out) { put(out, rotate(pose, v)); });
}

nb::object apply_poses(const Pose& pose, nb::handle poses) {
  return map_items<7>(poses, "poses", [pose](const double* p, double* out) {
    const Pose product = pose * Pose{p[0], p[1], p[2], p[3], p[4], p[5], p[6]};
    std::copy_n(&product.x, 7, out);
  });
}

nb::object apply_covariance(const Pose& pose, nb::handle covariance) {
  return map_items<6, 6>(covariance, "covariance", [pose](const double* c, double* out) {
    // diag(R, R) C diag(R, R)^T: every half of a column is rotated, then every half of a row.
    double turned[36];
    for (int column = 0; column < 6; ++column)
      for (int half = 0; half < 36; half += 18) {
        const int at = half + column;
        const Vec3 v = ztf::rotate(pose, c[at], c[at + 6], c[at + 12]);
        turned[at] = v.x;
        turned[at + 6] = v.y;
        turned[at + 12] = v.z;
      }
    for (int half = 0; half < 36; half += 3) put(out + half, rotate(pose, turned + half));
  });
}

nb::object apply_wrench(const Pose& pose, nb::handle wrench) {
  return map_items<6>(wrench, "wrench", [pose](const double* w, double* out) {
    const Vec3 force = rotate(pose, w);
    put(out, force);
    put_sum(out + 3, rotate(pose, w + 3), lever(pose, force));
  });
}

nb::object apply_twist(const Pose& pose, nb::handle twist) {
  return map_items<6>(twist, "twist", [pose](const double* t, double* out) {
    const Vec3 angular = rotate(pose, t + 3);
    put_sum(out, rotate(pose, t), lever(pose, angular));
    put(out + 3, angular);
  });
}

}  // namespace

void bind_apply(nb::class_<Pose>& transform) {
  transform
      .def("apply", &apply_points, nb::arg("points").none(),
           "Points (..., 3) in child, metres -> the same points in parent: R p + t.\n\n"
           "As all apply methods: any leading shape, strides and real dtype; the result is a new\n"
           "float64 array. `InvalidArgumentException` if the shape is another.")
      .def("apply_vectors", &apply_vectors, nb::arg("vectors").none(),
           "Directions (..., 3) in child's axes -> in parent's axes: R v.\n\n"
           "For what has no place: normals, displacements, fields. The translation does nothing.")
      .def("apply_poses", &apply_poses, nb::arg("poses").none(),
           "Poses (..., 7) in child, rows x, y, z, qx, qy, qz, qw -> the same poses in parent.\n\n"
           "Row by row what `X_parent_child @ X_child_body` gives as a pose; quaternions of unit\n"
           "length stay so, and are neither normalised nor changed in sign.")
      .def("apply_covariance", &apply_covariance, nb::arg("covariance").none(),
           "Covariances (..., 6, 6) of poses in child -> of the same poses in parent.\n\n"
           "Rows and columns x, y, z (metres), turns about x, y, z (radians), in the axes of the\n"
           "frame that the pose is given in, as in ROS's PoseWithCovariance. The result is\n"
           "diag(R, R) C diag(R, R)^T, the rule of tf2_geometry_msgs. There is no lever arm: the\n"
           "errors are those of the body's position and of its turning on the spot; errors of a\n"
           "turn about the frame's origin would take the adjoint. The transform counts as exact.")
      .def("apply_wrench", &apply_wrench, nb::arg("wrench").none(),
           "Wrenches (..., 6) at child's origin -> the equal wrenches at parent's origin.\n\n"
           "Rows fx, fy, fz (newtons), tx, ty, tz (newton metres), in the axes of their frame:\n"
           "force' = R force, torque' = R torque + t x (R force), the shift of a wrench's "
           "reference\n"
           "point in rigid-body statics, which tf2_geometry_msgs does too.")
      .def(
          "apply_twist", &apply_twist, nb::arg("twist").none(),
          "Twists (..., 6) of a body at child's origin -> of the same body at parent's origin.\n\n"
          "Rows vx, vy, vz (metres a second), wx, wy, wz (radians a second), in the axes of their\n"
          "frame; the linear part is the velocity of the point of the body that is at the frame's\n"
          "origin: angular' = R w, linear' = R v + t x (R w), the adjoint map of rigid-body\n"
          "kinematics. The motion stays relative to the same observer: child and parent are taken\n"
          "as fixed to each other, and what they do is not added.");
}

}  // namespace ztf
