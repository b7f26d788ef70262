// Tree._estimate: a zenoh_tf.Estimate; Tree._estimate_record: its fields. Tree._set_motion_limits,
// Tree._motion_limits.
//
// GIL: kept, as by every single lookup, but released for backtests.
#include <cmath>

#include "bindings/transforms/estimate_class.hpp"

namespace ztf {

namespace {

template <class AnyTree>
Estimate estimate(const AnyTree& tree, nb::handle target, nb::handle source, nb::handle stamp,
                  Stamp now, double level, Stamp max_by, double radius) {
  EstimateQuery query = estimate_query(stamp, now, level, max_by, radius);
  const std::string_view target_name = frame_name_of(target, "target_frame"),
                         source_name = frame_name_of(source, "source_frame");
  EstimateAnswer a;
  Estimate found;
  const auto ask = [&] {
    query.target = tree.find(target_name);
    query.source = tree.find(source_name);
    tree.estimate(query, a);
    if (a.failure.code != Code::ok) return true;
    if (a.child != 0) {
      found.parent = tree.name(a.parent);
      found.child = tree.name(a.child);
    }
    found.carried.clear();
    found.carried.reserve(a.carried.size());
    for (const CarriedLink& link : a.carried)
      found.carried.emplace_back(tree.name(link.child), link.by_twist);
    return true;
  };
  {
    const GilReleasedOnWait released;
    (void)tree.read_names(ask);
  }
  if (a.failure.code != Code::ok) {
    const LookupNote note{.max_by = query.max_by};
    raise(lookup_error(tree, a.failure, target_name, source_name, note));
  }
  static const nb::handle bases[] = {interned("backtest"), interned("limits"), interned("static")};
  found.target = nb::borrow(target);
  found.source = nb::borrow(source);
  found.pose = a.pose;
  found.stamp = query.stamp;
  found.metres = a.metres;
  found.radians = a.radians;
  found.level = a.level;
  found.backtests = a.backtests;
  found.basis = nb::borrow(bases[static_cast<int>(a.basis)]);
  found.by = a.by;
  return found;
}

template <class AnyTree>
nb::dict estimate_record(const AnyTree& tree, nb::handle target, nb::handle source,
                         nb::handle stamp, Stamp now, double level, Stamp max_by, double radius) {
  return record_of(estimate(tree, target, source, stamp, now, level, max_by, radius));
}

template <class AnyTree>
void set_motion_limits(AnyTree& tree, nb::handle child, double speed, double accel, double rate,
                       double rate_accel, double clock_error) {
  tree.set_motion_limits(frame_name_of(child, "child"),
                         {speed, accel, rate, rate_accel, clock_error});
}

nb::dict motion_limits(const Tree& tree) {
  nb::dict out;
  for (const auto& [child, limits] : tree.all_motion_limits())
    out[str_of(child)] = nb::make_tuple(limits.speed, limits.accel, limits.rate, limits.rate_accel,
                                        limits.clock_error);
  return out;
}

}  // namespace

EstimateQuery estimate_query(nb::handle stamp, Stamp now, double level, Stamp max_by,
                             double radius) {
  EstimateQuery query{};
  query.now = now;
  query.stamp = stamp.is_none() ? now : stamp_of(stamp, "stamp_ns");
  if (!(level > 0 && level < 1)) raise_invalid("level must be above 0 and below 1", "level");
  if (max_by < 0) raise_invalid("max_by_s must be 0 or more", "max_by_s");
  if (!(radius >= 0 && std::isfinite(radius)))
    raise_invalid("radius_m must be 0 or more, and finite", "radius_m");
  query.level = level;
  query.max_by = max_by;
  query.radius = radius;
  return query;
}

template <class T>
void bind_estimate(nb::class_<T>& tree) {
  tree.def("_estimate_record", method<&estimate_record<T>>, name_arg("target_frame"),
           name_arg("source_frame"), nb::arg("stamp_ns").none(), nb::arg("now_ns"),
           nb::arg("level"), nb::arg("max_by_ns"), nb::arg("radius_m"));
  tree.def("_estimate", method<&estimate<T>>, name_arg("target_frame"), name_arg("source_frame"),
           nb::arg("stamp_ns").none(), nb::arg("now_ns"), nb::arg("level"), nb::arg("max_by_ns"),
           nb::arg("radius_m"));
  tree.def("_set_motion_limits", &set_motion_limits<T>, nb::arg("child"), nb::arg("speed"),
           nb::arg("accel"), nb::arg("rate"), nb::arg("rate_accel"), nb::arg("clock_error"));
  if constexpr (std::is_same_v<T, Tree>) tree.def("_motion_limits", &motion_limits);
}
template void bind_estimate(nb::class_<Tree>&);
template void bind_estimate(nb::class_<SharedTree>&);

}  // namespace ztf
