// zenoh_tf.Estimate: the answer of an estimate.
#include "bindings/transforms/estimate_class.hpp"

namespace ztf {

namespace {

constexpr const char* kFields[] = {"target_frame", "source_frame", "transform",     "stamp_ns",
                                   "error_m",      "error_rad",    "level",         "backtests",
                                   "basis",        "by_ns",        "limiting_link", "predictor"};
constexpr int kTransform = 2;

nb::object limiting_link(const Estimate& e) {
  if (!e.limiting_link)
    e.limiting_link = e.child.empty()
                          ? nb::object(nb::none())
                          : nb::object(nb::make_tuple(str_of(e.parent), str_of(e.child)));
  return e.limiting_link;
}

nb::object predictor(const Estimate& e) {
  static const nb::handle predictors[] = {interned("hold"), interned("twist")};
  if (!e.predictor) {
    nb::dict made;
    for (const auto& [child, by_twist] : e.carried) made[str_of(child)] = predictors[by_twist];
    e.predictor = made;
  }
  return e.predictor;
}

// In the order of kFields.
nb::tuple fields(const Estimate& e) {
  return nb::make_tuple(e.target, e.source, e.pose, e.stamp, e.metres, e.radians, e.level,
                        e.backtests, e.basis, e.by, limiting_link(e), predictor(e));
}

std::string repr(const Estimate& e) {
  std::string text = "Estimate(";
  const nb::tuple values = fields(e);
  for (std::size_t i = 0; i < std::size(kFields); ++i)
    text +=
        std::string(i ? ", " : "") + kFields[i] + "=" + nb::cast<std::string>(nb::repr(values[i]));
  return text + ")";
}

}  // namespace

nb::handle interned(const char* text) { return PyUnicode_InternFromString(text); }

nb::dict record_of(const Estimate& e) {
  nb::dict record;
  const nb::tuple values = fields(e);
  for (std::size_t i = 0; i < std::size(kFields); ++i) record[kFields[i]] = values[i];
  record[kFields[kTransform]] = nb::list(numbers(&e.pose.x, 7));
  return record;
}

void bind_estimate_class(nb::module_& m) {
  nb::class_<Estimate> estimate(m, "Estimate", nb::pooled(), docs::Estimate.text);
  estimate
      .def(
          "__init__",
          [](Estimate* self, nb::str target, nb::str source, const Pose& transform, Stamp stamp,
             double metres, double radians, double level, std::int64_t backtests, nb::str basis,
             Stamp by, nb::object limiting, nb::dict predictors) {
            new (self) Estimate{target, source,    transform, stamp, metres,   radians,
                                level,  backtests, basis,     by,    limiting, predictors};
          },
          nb::arg("target_frame"), nb::arg("source_frame"), nb::arg("transform"),
          nb::arg("stamp_ns"), nb::arg("error_m"), nb::arg("error_rad"), nb::arg("level"),
          nb::arg("backtests"), nb::arg("basis"), nb::arg("by_ns"), nb::arg("limiting_link").none(),
          nb::arg("predictor"))
      .def_ro("target_frame", &Estimate::target)
      .def_ro("source_frame", &Estimate::source)
      .def_prop_ro("transform", [](const Estimate& e) { return e.pose; })
      .def_ro("stamp_ns", &Estimate::stamp)
      .def_ro("error_m", &Estimate::metres)
      .def_ro("error_rad", &Estimate::radians)
      .def_ro("level", &Estimate::level)
      .def_ro("backtests", &Estimate::backtests)
      .def_ro("basis", &Estimate::basis)
      .def_ro("by_ns", &Estimate::by)
      .def_prop_ro("limiting_link", &limiting_link)
      .def_prop_ro("predictor", &predictor)
      .def(
          "__eq__", [](const Estimate& a, const Estimate& b) { return fields(a).equal(fields(b)); },
          nb::is_operator())
      .def("__hash__",
           [](const Estimate& e) {
             return nb::hash(nb::make_tuple(e.target, e.source, e.stamp, e.metres, e.radians));
           })
      .def("__repr__", &repr)
      .def("__reduce__", [](nb::handle self) {
        return nb::make_tuple(self.type(), fields(nb::cast<const Estimate&>(self)));
      });
  nb::list names;
  for (const char* name : kFields) names.append(name);
  estimate.attr("__match_args__") = nb::tuple(names);
}

}  // namespace ztf
