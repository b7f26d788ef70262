// Tree._estimate: a zenoh_tf.Estimate; Tree._estimate_record: its fields. Tree._set_motion_limits,
// Tree._motion_limits.
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

template <class AnyTree>
void estimate(const AnyTree& tree, nb::handle target, nb::handle source, EstimateQuery& query,
              NamedEstimate& found) {
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
  const Failure& failure = found.answer.failure;
  if (failure.code == Code::ok) return;
  const std::string note =
      failure.code == Code::forward
          ? " and carried on by at most " + std::to_string(query.max_by) + " ns (max_by_s)"
          : "";
  raise(make_error(tree, failure, target, source, note));
}

// A str that is made once, and lives as long as the process.
nb::handle interned(const char* text) { return PyUnicode_InternFromString(text); }

// Calls put(name, value) for each field of zenoh_tf.Estimate.
template <class Put>
void put_fields(const NamedEstimate& found, const EstimateQuery& query, nb::handle target,
                nb::handle source, const nb::object& transform, Put&& put) {
  const EstimateAnswer& a = found.answer;
  static const nb::handle bases[] = {interned("backtest"), interned("limits"), interned("static")};
  static const nb::handle predictors[] = {interned("hold"), interned("twist")};
  static const nb::handle names[] = {
      interned("target_frame"), interned("source_frame"),  interned("transform"),
      interned("stamp_ns"),     interned("error_m"),       interned("error_rad"),
      interned("level"),        interned("backtests"),     interned("basis"),
      interned("by_ns"),        interned("limiting_link"), interned("predictor")};
  const nb::handle* name = names;
  const auto next = [&](const nb::handle& value) { put(*name++, value); };
  nb::dict predictor;
  for (std::size_t i = 0; i < found.carried.size(); ++i)
    predictor[str_of(found.carried[i])] = predictors[a.carried[i].by_twist];
  next(target);
  next(source);
  next(transform);
  next(nb::int_(query.stamp));
  next(nb::float_(a.metres));
  next(nb::float_(a.radians));
  next(nb::float_(a.level));
  next(nb::int_(a.backtests));
  next(bases[static_cast<int>(a.basis)]);
  next(nb::int_(a.by));
  next(a.child == 0 ? nb::object(nb::none())
                    : nb::object(nb::make_tuple(str_of(found.parent), str_of(found.child))));
  next(predictor);
}

template <class AnyTree>
nb::dict estimate_record(const AnyTree& tree, nb::handle target, nb::handle source,
                         nb::handle stamp, Stamp now, double level, Stamp max_by, double radius) {
  EstimateQuery query = estimate_query(stamp, now, level, max_by, radius);
  NamedEstimate found;
  estimate(tree, target, source, query, found);
  nb::list pose;
  const double* const values = &found.answer.pose.x;
  for (int i = 0; i < 7; ++i) pose.append(values[i]);
  nb::dict out;
  put_fields(found, query, target, source, pose,
             [&](nb::handle name, nb::handle value) { out[name] = value; });
  return out;
}

// The same as an instance of that class, which is frozen: its fields are set as its constructor
// does. That takes a third of the time that the constructor would.
template <class AnyTree>
nb::object estimate_object(const AnyTree& tree, nb::handle kind, nb::handle target,
                           nb::handle source, nb::handle stamp, Stamp now, double level,
                           Stamp max_by, double radius) {
  EstimateQuery query = estimate_query(stamp, now, level, max_by, radius);
  NamedEstimate found;
  estimate(tree, target, source, query, found);
  static const nb::handle create = interned("__new__");
  const nb::object out = kind.attr(create)(kind);
  put_fields(found, query, target, source, nb::cast(found.answer.pose),
             [&](nb::handle name, nb::handle value) {
               if (PyObject_GenericSetAttr(out.ptr(), name.ptr(), value.ptr()))
                 throw nb::python_error();
             });
  return out;
}

template <class AnyTree>
void set_motion_limits(AnyTree& tree, nb::handle child, double speed, double accel, double rate,
                       double rate_accel) {
  tree.set_motion_limits(frame_name_of(child, "child"), {speed, accel, rate, rate_accel});
}

nb::dict motion_limits(const Tree& tree) {
  nb::dict out;
  for (const auto& [child, limits] : tree.all_motion_limits())
    out[str_of(child)] = nb::make_tuple(limits.speed, limits.accel, limits.rate, limits.rate_accel);
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
  tree.def("_estimate_record", method<&estimate_record<T>>, nb::arg("target_frame"),
           nb::arg("source_frame"), nb::arg("stamp_ns").none(), nb::arg("now_ns"), nb::arg("level"),
           nb::arg("max_by_ns"), nb::arg("radius_m"));
  tree.def("_estimate", method<&estimate_object<T>>, nb::arg("kind"), nb::arg("target_frame"),
           nb::arg("source_frame"), nb::arg("stamp_ns").none(), nb::arg("now_ns"), nb::arg("level"),
           nb::arg("max_by_ns"), nb::arg("radius_m"));
  tree.def("_set_motion_limits", &set_motion_limits<T>, nb::arg("child"), nb::arg("speed"),
           nb::arg("accel"), nb::arg("rate"), nb::arg("rate_accel"));
  if constexpr (std::is_same_v<T, Tree>) tree.def("_motion_limits", &motion_limits);
}
template void bind_estimate(nb::class_<Tree>&);
template void bind_estimate(nb::class_<SharedTree>&);

}  // namespace ztf
