// Transforms of many points: the kernels behind Transform.apply() and deskew().
//
// All arithmetic is in double, whatever the arrays hold.
//
// Thread safety: every function, on arrays that no other thread changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>

#include "geometry/pose4.hpp"

namespace ztf {

// An array of points, (rows, columns, 3) floats or doubles, with any distances in bytes between
// them. A distance of 0 repeats the same ones.
struct PointArray {
  std::byte* data;
  std::size_t rows, columns;
  std::ptrdiff_t row_stride, column_stride, coordinate_stride;
  bool is_double;

  // Returns some points of one row, as an array of one row.
  [[nodiscard]] PointArray part(std::size_t row, std::size_t begin, std::size_t n) const noexcept {
    PointArray some = *this;
    some.data += static_cast<std::ptrdiff_t>(row) * row_stride +
                 static_cast<std::ptrdiff_t>(begin) * column_stride;
    some.rows = 1;
    some.columns = n;
    return some;
  }
};

// A pose as the columns of its matrix: a point's image is x * c[0] + y * c[1] + z * c[2] + c[3].
struct PointMap {
  Double4 c[4];

  ZTF_ALWAYS_INLINE static PointMap of(const Pose& p) noexcept {
    const double x = p.qx + p.qx, y = p.qy + p.qy, z = p.qz + p.qz;
    return {{Double4{1 - (y * p.qy + z * p.qz), x * p.qy + z * p.qw, x * p.qz - y * p.qw, 0},
             Double4{x * p.qy - z * p.qw, 1 - (x * p.qx + z * p.qz), y * p.qz + x * p.qw, 0},
             Double4{x * p.qz + y * p.qw, y * p.qz - x * p.qw, 1 - (x * p.qx + y * p.qy), 0},
             Double4{p.x, p.y, p.z, 0}}};
  }
  // The maps of four poses.
  ZTF_ALWAYS_INLINE static void of(const Pose4& p, PointMap* out) noexcept {
    const Double4 x = p.qx + p.qx, y = p.qy + p.qy, z = p.qz + p.qz;
    const Double4 m[4][3] = {
        {1.0 - (y * p.qy + z * p.qz), x * p.qy + z * p.qw, x * p.qz - y * p.qw},
        {x * p.qy - z * p.qw, 1.0 - (x * p.qx + z * p.qz), y * p.qz + x * p.qw},
        {x * p.qz + y * p.qw, y * p.qz - x * p.qw, 1.0 - (x * p.qx + y * p.qy)},
        {p.x, p.y, p.z}};
    for (std::size_t lane = 0; lane < 4; ++lane)
      for (std::size_t column = 0; column < 4; ++column)
        out[lane].c[column] =
            Double4{m[column][0][lane], m[column][1][lane], m[column][2][lane], 0};
  }
};

using Float4 = float __attribute__((vector_size(16)));
template <class T>
using Vector4 = std::conditional_t<std::is_same_v<T, float>, Float4, Double4>;

template <class T>
ZTF_ALWAYS_INLINE double load_number(const std::byte* from) noexcept {
  T value;  // it may be anywhere, also at an odd address
  std::memcpy(&value, from, sizeof value);
  return value;
}

template <class T>
ZTF_ALWAYS_INLINE void store_number(std::byte* to, T value) noexcept {
  std::memcpy(to, &value, sizeof value);
}

// Writes the image of one point. `in` and `out` may be the same point.
template <class In, class Out>
ZTF_ALWAYS_INLINE void map_point(const PointMap& map, const std::byte* in, std::ptrdiff_t in_stride,
                                 std::byte* out, std::ptrdiff_t out_stride) noexcept {
  const double x = load_number<In>(in), y = load_number<In>(in + in_stride),
               z = load_number<In>(in + 2 * in_stride);
  const Double4 image = ((map.c[3] + x * map.c[0]) + y * map.c[1]) + z * map.c[2];
  const Vector4<Out> rounded = __builtin_convertvector(image, Vector4<Out>);
  store_number<Out>(out, rounded[0]);
  store_number<Out>(out + out_stride, rounded[1]);
  store_number<Out>(out + 2 * out_stride, rounded[2]);
}

// Calls body.operator()<In, Out>() with the types of two arrays' numbers.
template <class Body>
ZTF_ALWAYS_INLINE void with_types(const PointArray& in, const PointArray& out, Body&& body) {
  if (in.is_double)
    out.is_double ? body.template operator()<double, double>()
                  : body.template operator()<double, float>();
  else
    out.is_double ? body.template operator()<float, double>()
                  : body.template operator()<float, float>();
}

// Writes the images of all points under one pose. Requires arrays of the same shape, which are the
// same or do not overlap.
void map_points(const Pose& pose, const PointArray& in, const PointArray& out) noexcept;
// The same with a pose for each row, and as many poses as rows.
void map_rows(std::span<const Pose> poses, const PointArray& in, const PointArray& out) noexcept;
// Writes the images of one row of points, point i by maps[numbers[i]].
void map_numbered(const PointMap* maps, std::span<const std::uint32_t> numbers,
                  const PointArray& in, const PointArray& out) noexcept;

}  // namespace ztf
