// Tree._deskew, and the same from poses that were looked up before: see zenoh_tf/clouds/points.py.
//
// GIL: kept while the motion is copied out of the tree, as by every single lookup; released for
// the points, if there are many.
#include "geometry/deskew.hpp"

#include "bindings/transforms/points.hpp"
#include "reads/motion.hpp"

namespace ztf {

PointArray checked_points(const AnyConstArray& array, const char* field) {
  const std::optional<PointArray> points = points_of(array);
  if (!points || array.ndim() != 3)
    raise_invalid(std::string(field) + " must be floats of the shape (rows, columns, 3)", field);
  return *points;
}

PointArray checked_output(const AnyArray& array, const PointArray& points) {
  const std::optional<PointArray> out = points_of(array);
  if (!out || array.ndim() != 3 || out->rows != points.rows || out->columns != points.columns)
    raise_invalid("out must be floats of the points' shape", "out");
  return *out;
}

namespace {

using StampGrid = nb::ndarray<const Stamp, nb::ndim<2>, nb::device::cpu>;

// The arrays of a sweep.
struct Sweep {
  Sweep(const AnyConstArray& points, const StampGrid& stamps, const AnyArray& output)
      : in(checked_points(points, "points")),
        out(checked_output(output, in)),
        times{reinterpret_cast<const std::byte*>(stamps.data()),
              stamps.stride(0) * static_cast<std::ptrdiff_t>(sizeof(Stamp)),
              stamps.stride(1) * static_cast<std::ptrdiff_t>(sizeof(Stamp))} {
    if (stamps.shape(0) != in.rows || stamps.shape(1) != in.columns)
      raise_invalid("stamps_ns must have a stamp for each point", "stamps_ns");
  }

  // Requires at least one point.
  [[nodiscard]] std::pair<Stamp, Stamp> first_and_last() const noexcept {
    Stamp first = times(0, 0), last = first;
    for (std::size_t row = 0; row < (times.row_stride == 0 ? 1 : in.rows); ++row)
      for (std::size_t column = 0; column < in.columns; ++column) {
        const Stamp time = times(row, column);
        first = std::min(first, time);
        last = std::max(last, time);
      }
    return {first, last};
  }
  template <class AnyMotion>
  void compensate(AnyMotion& motion) const {
    without_gil_if_long(3 * in.rows * in.columns, [&] { deskew(motion, times, in, out); });
  }

  const PointArray in, out;
  const StampArray times;
};

// Returns false, and writes nothing, if each time has to be looked up by itself.
template <class AnyTree>
bool deskew_by_tree(const AnyTree& tree, const AnyConstArray& points, const StampGrid& stamps,
                    const AnyArray& out, nb::handle source, nb::handle fixed, Stamp at,
                    Stamp max_gap) {
  const Sweep sweep(points, stamps, out);
  MotionQuery query{0, 0, at, at, at, max_gap};
  if (sweep.in.rows * sweep.in.columns > 0)
    std::tie(query.first, query.last) = sweep.first_and_last();
  if (query.first == kNoStamp)
    raise_invalid("stamps_ns has -2^63; stamps are nanoseconds from -2^63 + 1 to 2^63 - 1",
                  "stamps_ns");
  const std::string_view fixed_name = frame_name_of(fixed, "fixed_frame"),
                         source_name = frame_name_of(source, "source_frame");
  Motion motion;
  Answer answer;
  MotionResult result;
  {
    const GilReleasedOnWait released;
    result = tree.read_names([&] {
      query.fixed = tree.find(fixed_name);
      query.source = tree.find(source_name);
      return tree.lookup_motion(query, motion, answer);
    });
  }
  if (answer.failure.code != Code::ok)
    raise(lookup_error(tree, answer.failure, fixed_name, source_name));
  if (result == MotionResult::varies) return false;
  motion.fix_at(at);
  sweep.compensate(motion);
  return true;
}

// The same with X_fixed_source at each of the sweep's times, ascending, and at the time to move to.
void deskew_by_samples(const AnyConstArray& points, const StampGrid& stamps, const AnyArray& out,
                       const Column<Stamp>& times, const PoseColumn& poses, nb::handle at) {
  const Sweep sweep(points, stamps, out);
  if (times.shape(0) != poses.shape(0) ||
      (times.shape(0) == 0 && sweep.in.rows * sweep.in.columns > 0))
    raise_invalid("poses must have a row for each time", "poses");
  Pose X_fixed_source;
  numbers_of(at, &X_fixed_source.x, 7, "at");
  const SampledMotion motion(span_of(times), span_of(poses), X_fixed_source);
  sweep.compensate(motion);
}

// Transforms row i of the points by pose i.
void map_rows_by_poses(const PoseColumn& poses, const AnyConstArray& points, const AnyArray& out) {
  const PointArray in = checked_points(points, "points");
  const PointArray to = checked_output(out, in);
  if (poses.shape(0) != in.rows) raise_invalid("poses must have a row for each of points", "poses");
  without_gil_if_long(3 * in.rows * in.columns, [&] { map_rows(span_of(poses), in, to); });
}

}  // namespace

void bind_deskew(nb::module_& m) {
  m.def("deskew_by_samples", &deskew_by_samples, nb::arg("points"), nb::arg("stamps_ns"),
        nb::arg("out"), nb::arg("times"), nb::arg("poses"), nb::arg("at"));
  m.def("map_rows", &map_rows_by_poses, nb::arg("poses"), nb::arg("points"), nb::arg("out"));
}

template <class T>
void bind_deskew(nb::class_<T>& tree) {
  tree.def("_deskew", method<&deskew_by_tree<T>>, nb::arg("points"), nb::arg("stamps_ns"),
           nb::arg("out"), name_arg("source"), name_arg("fixed_frame"), nb::arg("at_ns"),
           nb::arg("max_gap_ns") = kNoGapLimit);
}
template void bind_deskew(nb::class_<Tree>&);
template void bind_deskew(nb::class_<SharedTree>&);

}  // namespace ztf
