// Transform's apply methods: what is given in child, expressed in parent.
//
// GIL: long arrays release it.
#include "bindings/transforms/points.hpp"

namespace ztf {

namespace {

// Maps an array of shape (..., *Tail) to a new one of the same shape, item by item.
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
  without_gil_if_long(size, [&] {
    for (std::size_t i = 0; i < size; i += step) item(from + i, to + i);
  });
  return result;
}

Vec3 rotate(const Pose& pose, const double* v) { return rotate(pose, v[0], v[1], v[2]); }

// t x v, the lever arm's part, where t is the pose's translation.
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

// The array to write to: `out`, or a new one of doubles.
nb::object output_like(const AnyConstArray& points, nb::handle out) {
  if (!out.is_none()) return nb::borrow(out);
  nb::list shape;
  for (std::size_t axis = 0; axis < points.ndim(); ++axis) shape.append(points.shape(axis));
  return nb::module_::import_("numpy").attr("empty")(nb::tuple(shape));
}

bool same_shape(const AnyConstArray& a, const AnyArray& b) {
  if (a.ndim() != b.ndim()) return false;
  for (std::size_t axis = 0; axis < a.ndim(); ++axis)
    if (a.shape(axis) != b.shape(axis)) return false;
  return true;
}

nb::object apply_points(const Pose& pose, nb::handle points, nb::handle out) {
  AnyConstArray array;
  std::optional<PointArray> in;
  if (nb::try_cast(points, array, false)) in = points_of(array);
  nb::object converted;
  if (!in) {  // other numbers, nested sequences, or more axes than strides can describe
    converted = doubles_of(points, "points");
    array = nb::cast<AnyConstArray>(converted);
    in = points_of(array);
    if (!in) raise_invalid("points must have the shape (..., 3)", "points");
  }
  const nb::object result = output_like(array, out);
  AnyArray written;
  std::optional<PointArray> to;
  if (nb::try_cast(result, written, false) && same_shape(array, written)) to = points_of(written);
  if (!to)
    raise_invalid(
        "out must be a writable float32 or float64 array with the shape of points, contiguous if "
        "it has more than three axes",
        "out");
  without_gil_if_long(array.size(), [&] { map_points(pose, *in, *to); });
  return result;
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
    // diag(R, R) C diag(R, R)^T: rotate each half of each column, then each half of each row.
    double rotated[36];
    for (int column = 0; column < 6; ++column)
      for (int half = 0; half < 36; half += 18) {
        const int at = half + column;
        const Vec3 v = ztf::rotate(pose, c[at], c[at + 6], c[at + 12]);
        rotated[at] = v.x;
        rotated[at + 6] = v.y;
        rotated[at + 12] = v.z;
      }
    for (int half = 0; half < 36; half += 3) put(out + half, rotate(pose, rotated + half));
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
      .def("apply", &apply_points, ZTF_DOC(Transform_apply), nb::arg("points").none(),
           nb::arg("out").none() = nb::none())
      .def("apply_vectors", &apply_vectors, ZTF_DOC(Transform_apply_vectors),
           nb::arg("vectors").none())
      .def("apply_poses", &apply_poses, ZTF_DOC(Transform_apply_poses), nb::arg("poses").none())
      .def("apply_covariance", &apply_covariance, ZTF_DOC(Transform_apply_covariance),
           nb::arg("covariance").none())
      .def("apply_wrench", &apply_wrench, ZTF_DOC(Transform_apply_wrench), nb::arg("wrench").none())
      .def("apply_twist", &apply_twist, ZTF_DOC(Transform_apply_twist), nb::arg("twist").none());
}

}  // namespace ztf
