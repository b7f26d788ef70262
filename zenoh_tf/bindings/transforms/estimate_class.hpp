// zenoh_tf.Estimate: what estimate.cpp makes.
//
// Thread safety: everything here requires the GIL.
#pragma once

#include "bindings/transforms/transform.hpp"

namespace ztf {

struct Estimate {
  nb::object target, source;
  Pose pose;
  Stamp stamp;
  double metres, radians, level;
  std::int64_t backtests;
  nb::object basis;
  Stamp by;
  // Few callers read them, so the objects are made of the names when they are asked for.
  mutable nb::object limiting_link, predictor;
  std::string parent, child;                          // of the limiting link; empty: none
  std::vector<std::pair<std::string, bool>> carried;  // children, and whether by twist
};

// A str that is made once, and lives as long as the process.
nb::handle interned(const char* text);
// The fields by name, with the transform as a list of numbers.
nb::dict record_of(const Estimate& estimate);

}  // namespace ztf
