// Tree._estimate_record: the fields of zenoh_tf.Estimate. Tree._set_motion_limits.
//
// GIL: kept, as by every single lookup, but released for backtests.
#include <cmath>

#include "bindings/bindings.hpp"

namespace ztf {

namespace {

// An estimate with the names of its links, which belong to its ids.
struct NamedEstimate {
  EstimateAnswer answer;
  std::string parent, child;
  std::vector<std::string> carried;
};

constexpr const char* kBases[] = {"backtest", "limits", "static"};

template <class AnyTree>
nb::dict estimate_record(const AnyTree& tree, nb::handle target, nb::handle source,
                         nb::handle stamp, Stamp now, double level, Stamp max_by, double radius) {
  EstimateQuery query = estimate_query(stamp, now, level, max_by, radius);
  NamedEstimate found;
  (void)tree.read_names([&] {
    query.target = frame_of(tree, target, "target_frame").id;
    query.source = frame_of(tree, source, "source_frame").id;
    const GilReleasedOnWait released;
    tree.estimate(query, found.answer);
    if (found.answer.failure.code != Code::ok) return true;
    if (found.answer.child != 0) {
      found.parent = tree.name(found.answer.parent);
      found.child = tree.name(found.answer.child);
    }
    found.carried.clear();
    for (const CarriedLink& link : found.answer.carried)
      found.carried.push_back(tree.name(link.child));
    return true;
  });
  const EstimateAnswer& a = found.answer;
  if (a.failure.code != Code::ok) {
    const bool is_known = query.target != 0 && query.source != 0;
    const std::string note =
        is_known && a.failure.code == Code::forward
            ? " and carried on by at most " + std::to_string(max_by) + " ns (max_by_s)"
            : "";
    raise(make_error(tree, a.failure, target, source, note));
  }
  nb::list pose;
  for (const double value :
       {a.pose.x, a.pose.y, a.pose.z, a.pose.qx, a.pose.qy, a.pose.qz, a.pose.qw})
    pose.append(value);
  nb::dict predictor;
  for (std::size_t i = 0; i < found.carried.size(); ++i)
    predictor[str_of(found.carried[i])] = a.carried[i].by_twist ? "twist" : "hold";
  nb::dict out;
  out["target_frame"] = target;
  out["source_frame"] = source;
  out["transform"] = pose;
  out["stamp_ns"] = query.stamp;
  out["error_m"] = a.metres;
  out["error_rad"] = a.radians;
  out["level"] = a.level;
  out["backtests"] = a.backtests;
  out["basis"] = kBases[static_cast<int>(a.basis)];
  out["by_ns"] = a.by;
  out["limiting_link"] =
      a.child == 0 ? nb::object(nb::none())
                   : nb::object(nb::make_tuple(str_of(found.parent), str_of(found.child)));
  out["predictor"] = predictor;
  return out;
}

void set_motion_limits(Tree& tree, nb::handle child, double speed, double accel, double rate,
                       double rate_accel) {
  tree.set_motion_limits(frame_name_of(child, "child"), {speed, accel, rate, rate_accel});
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
  tree.def("_estimate_record", method<&estimate_record<T>>, nb::arg("target_frame"),
           nb::arg("source_frame"), nb::arg("stamp_ns").none(), nb::arg("now_ns"), nb::arg("level"),
           nb::arg("max_by_ns"), nb::arg("radius_m"));
  if constexpr (std::is_same_v<T, Tree>)
    tree.def("_set_motion_limits", &set_motion_limits, nb::arg("child"), nb::arg("speed"),
             nb::arg("accel"), nb::arg("rate"), nb::arg("rate_accel"));
}
template void bind_estimate(nb::class_<Tree>&);
template void bind_estimate(nb::class_<SharedTree>&);

}  // namespace ztf
