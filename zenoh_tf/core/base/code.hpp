// Why a lookup failed or a write was rejected, as a number.
//
// Thread safety: values.
#pragma once

#include <cstdint>

namespace ztf {

// The numbers of zenoh_tf/errors.py, which documents the meaning of each.
enum class Code : std::uint8_t {
  ok = 0,
  lookup = 2,
  connectivity = 3,
  invalid_argument = 4,
  timeout = 5,
  extrapolation = 6,
  no_data = 7,
  backward = 8,
  forward = 9,
  conflict = 10,
  limit = 11,
  protocol = 16,
  gap = 22,
  starting = 23,
  stale_frame = 64,  // of references, which C has and Python has not
};

}  // namespace ztf
