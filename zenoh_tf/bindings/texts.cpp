// What zenoh_tf.text has from the core.
#include "bindings/bindings.hpp"
#include "by_name/similar.hpp"
#include "by_name/stamp_units.hpp"

namespace ztf {

void bind_texts(nb::module_& m) {
  m.def("similar_names", &similar_names, nb::arg("name"), nb::arg("names"), nb::arg("most") = 3);
  m.def("did_you_mean", &did_you_mean, nb::arg("unknown"), nb::arg("names"));
  m.def("age", &age, nb::arg("length_ns"));
  m.def("other_unit", &other_unit, nb::arg("stamp_ns"), nb::arg("oldest_ns"), nb::arg("newest_ns"));
}

}  // namespace ztf
