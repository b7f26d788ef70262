// Arrays of points from Python, as the core's kernels accept them.
//
// Thread safety: everything here requires the GIL, except where it says "needs no GIL".
#pragma once

#include "bindings/bindings.hpp"
#include "geometry/point_map.hpp"

namespace ztf {

// Runs body(), without the GIL if it works on so many numbers that this pays: some 10 us of work.
template <class Body>
void without_gil_if_long(std::size_t numbers, Body&& body) {
  without_gil_if(numbers >= 10'000, std::forward<Body>(body));
}

// Arrays of any type and strides, in which only the types below mean something.
using AnyArray = nb::ndarray<nb::device::cpu>;
using AnyConstArray = nb::ndarray<nb::ro, nb::device::cpu>;

// Returns an array of floats or doubles with the shape (..., 3) as points. nullopt if it is none,
// or has more than three axes that are not contiguous.
template <class Array>
std::optional<PointArray> points_of(const Array& array) {
  const bool is_double = array.dtype() == nb::dtype<double>();
  const std::size_t axes = array.ndim();
  if ((!is_double && array.dtype() != nb::dtype<float>()) || axes < 1 || array.shape(axes - 1) != 3)
    return std::nullopt;
  const auto width = static_cast<std::ptrdiff_t>(is_double ? sizeof(double) : sizeof(float));
  const auto stride = [&](std::size_t axis) { return array.stride(axis) * width; };
  PointArray points{
      static_cast<std::byte*>(const_cast<void*>(static_cast<const void*>(array.data()))),
      1,
      1,
      0,
      0,
      stride(axes - 1),
      is_double};
  if (axes == 2 || axes == 3) {
    points.columns = array.shape(axes - 2);
    points.column_stride = stride(axes - 2);
  }
  if (axes == 3) {
    points.rows = array.shape(0);
    points.row_stride = stride(0);
  }
  if (axes > 3) {
    std::ptrdiff_t next = width;
    for (std::size_t axis = axes; axis-- > 0;) {
      if (array.shape(axis) != 1 && stride(axis) != next) return std::nullopt;
      next *= static_cast<std::ptrdiff_t>(array.shape(axis));
    }
    points.columns = array.size() / 3;
    points.column_stride = 3 * width;
  }
  return points;
}

// Arrays of sweeps, already brought to the shape (rows, columns, 3) by zenoh_tf/clouds/points.py.
// Raises for others.
PointArray checked_points(const AnyConstArray& array, const char* field);
PointArray checked_output(const AnyArray& array, const PointArray& points);

}  // namespace ztf
