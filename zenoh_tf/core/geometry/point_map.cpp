// The loops over points.
#include "geometry/point_map.hpp"

namespace ztf {

namespace {

// Writes the images of one row, point i by map_of(i).
template <class In, class Out, class MapOf>
ZTF_ALWAYS_INLINE void map_columns(MapOf&& map_of, const PointArray& in, const PointArray& out,
                                   std::size_t row) noexcept {
  const std::byte* from = in.data + static_cast<std::ptrdiff_t>(row) * in.row_stride;
  std::byte* to = out.data + static_cast<std::ptrdiff_t>(row) * out.row_stride;
  const auto map_all = [&](std::ptrdiff_t in_stride, std::ptrdiff_t out_stride)
                           __attribute__((always_inline)) {
                             for (std::size_t i = 0; i < in.columns; ++i) {
                               map_point<In, Out>(map_of(i), from, in_stride, to, out_stride);
                               from += in.column_stride;
                               to += out.column_stride;
                             }
                           };
  // Known distances make the usual case 1.3 times as fast.
  if (in.coordinate_stride == sizeof(In) && out.coordinate_stride == sizeof(Out))
    map_all(sizeof(In), sizeof(Out));
  else
    map_all(in.coordinate_stride, out.coordinate_stride);
}

}  // namespace

ZTF_MULTIVERSION void map_points(const Pose& pose, const PointArray& in,
                                 const PointArray& out) noexcept {
  const PointMap map = PointMap::of(pose);
  with_types(in, out, [&]<class In, class Out>() __attribute__((always_inline)) {
    for (std::size_t row = 0; row < in.rows; ++row)
      map_columns<In, Out>([&](std::size_t) -> const PointMap& { return map; }, in, out, row);
  });
}

ZTF_MULTIVERSION void map_rows(std::span<const Pose> poses, const PointArray& in,
                               const PointArray& out) noexcept {
  with_types(in, out, [&]<class In, class Out>() __attribute__((always_inline)) {
    for (std::size_t row = 0; row < in.rows; ++row) {
      const PointMap map = PointMap::of(poses[row]);
      map_columns<In, Out>([&](std::size_t) -> const PointMap& { return map; }, in, out, row);
    }
  });
}

ZTF_MULTIVERSION void map_numbered(const PointMap* maps, std::span<const std::uint32_t> numbers,
                                   const PointArray& in, const PointArray& out) noexcept {
  with_types(in, out, [&]<class In, class Out>() __attribute__((always_inline)) {
    map_columns<In, Out>([&](std::size_t i) -> const PointMap& { return maps[numbers[i]]; }, in,
                         out, 0);
  });
}

}  // namespace ztf
