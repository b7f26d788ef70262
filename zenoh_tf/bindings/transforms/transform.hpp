// What transform.cpp and stamped.cpp share.
//
// Thread safety: everything here requires the GIL.
#pragma once

#include "bindings/bindings.hpp"

namespace ztf {

// n doubles as a tuple of Python floats.
nb::tuple numbers(const double* values, int n);
// "Transform(translation=(...), rotation=(...))"
std::string repr_of(const Pose& pose);

}  // namespace ztf
