// Tree._velocity_record: the fields of zenoh_tf.Velocity.
//
// GIL: kept, as by every single lookup.
#include <cmath>

#include "bindings/bindings.hpp"

namespace ztf {

namespace {

template <class AnyTree>
nb::dict velocity_record(const AnyTree& tree, nb::handle tracking, nb::handle observation,
                         nb::handle stamp, Stamp interval, nb::handle reference_or_none,
                         nb::handle point, nb::handle point_frame_or_none, Stamp max_gap) {
  const nb::handle reference = reference_or_none.is_none() ? observation : reference_or_none;
  const nb::handle point_frame = point_frame_or_none.is_none() ? tracking : point_frame_or_none;
  const std::string_view tracking_name = frame_name_of(tracking, "tracking_frame"),
                         observation_name = frame_name_of(observation, "observation_frame"),
                         reference_name = frame_name_of(reference, "reference_frame"),
                         point_name = frame_name_of(point_frame, "reference_point_frame");
  VelocityQuery query{};
  query.stamp = stamp_of(stamp, "stamp_ns");
  query.interval = interval;
  query.max_gap = max_gap;
  numbers_of(point, &query.point.x, 3, "reference_point");
  for (const double value : {query.point.x, query.point.y, query.point.z})
    if (!std::isfinite(value)) raise_invalid("reference_point must be finite", "reference_point");
  if (interval < 1) raise_invalid("averaging_interval_s must be above 0", "averaging_interval_s");

  VelocityAnswer a;
  {
    const GilReleasedOnWait released;
    (void)tree.read_names([&] {
      query.tracking = tree.find(tracking_name);
      query.observation = tree.find(observation_name);
      query.reference = tree.find(reference_name);
      query.point_frame = tree.find(point_name);
      tree.lookup_velocity(query, a);
      return true;
    });
  }
  if (a.failure.code != Code::ok) {
    using Leg = VelocityAnswer::Leg;
    const bool to_reference = a.leg == Leg::reference;
    raise(lookup_error(tree, a.failure, to_reference ? reference_name : observation_name,
                       a.leg == Leg::tracking ? tracking_name
                       : to_reference         ? observation_name
                                              : point_name));
  }
  const auto listed = [](const Vec3& v) {
    nb::list out;
    for (const double value : {v.x, v.y, v.z}) out.append(value);
    return out;
  };
  nb::dict out;
  out["linear"] = listed(a.twist.linear);
  out["angular"] = listed(a.twist.angular);
  out["stamp_ns"] = a.stamp;
  out["start_ns"] = a.start;
  out["end_ns"] = a.end;
  out["gap_ns"] = a.gap;
  out["tracking_frame"] = tracking;
  out["observation_frame"] = observation;
  out["reference_frame"] = reference;
  return out;
}

}  // namespace

template <class T>
void bind_velocity(nb::class_<T>& tree) {
  tree.def("_velocity_record", method<&velocity_record<T>>, name_arg("tracking_frame"),
           name_arg("observation_frame"), nb::arg("stamp_ns").none(),
           nb::arg("averaging_interval_ns"), nb::arg("reference_frame").none(),
           nb::arg("reference_point"), nb::arg("reference_point_frame").none(),
           nb::arg("max_gap_ns") = kNoGapLimit);
}
template void bind_velocity(nb::class_<Tree>&);
template void bind_velocity(nb::class_<SharedTree>&);

}  // namespace ztf
