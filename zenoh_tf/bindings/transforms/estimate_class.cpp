// zenoh_tf.Estimate: the answer of an estimate.
#include "bindings/transforms/estimate_class.hpp"

#include <functional>

namespace ztf {

namespace {

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

// Calls visit(name, member or function of an estimate) for each field, in the order of the
// constructor's arguments.
template <class Visit>
void each_field(Visit&& visit) {
  visit("target_frame", &Estimate::target);
  visit("source_frame", &Estimate::source);
  visit("transform", &Estimate::pose);
  visit("stamp_ns", &Estimate::stamp);
  visit("error_m", &Estimate::metres);
  visit("error_rad", &Estimate::radians);
  visit("level", &Estimate::level);
  visit("backtests", &Estimate::backtests);
  visit("basis", &Estimate::basis);
  visit("by_ns", &Estimate::by);
  visit("limiting_link", &limiting_link);
  visit("predictor", &predictor);
}

// The fields by name, in their order.
nb::dict named_fields(const Estimate& e) {
  nb::dict out;
  each_field([&](const char* name, auto field) { out[name] = std::invoke(field, e); });
  return out;
}

nb::tuple fields(const Estimate& e) { return nb::tuple(named_fields(e).values()); }

std::string repr(const Estimate& e) {
  std::string text;
  for (const auto& [name, value] : named_fields(e))
    text += (text.empty() ? "Estimate(" : ", ") + nb::cast<std::string>(name) + "=" +
            nb::cast<std::string>(nb::repr(value));
  return text + ")";
}

}  // namespace

nb::handle interned(const char* text) { return PyUnicode_InternFromString(text); }

nb::dict record_of(const Estimate& e) {
  nb::dict record = named_fields(e);
  record["transform"] = nb::list(numbers(&e.pose.x, 7));
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
  each_field([&](const char* name, auto field) {
    names.append(name);
    estimate.def_prop_ro(name,
                         [field](const Estimate& e) { return nb::cast(std::invoke(field, e)); });
  });
  estimate.attr("__match_args__") = nb::tuple(names);
}

}  // namespace ztf
