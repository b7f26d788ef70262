// The folder `base/`: what every folder uses, and what depends on the machine.
// In: nothing of a tree. Out: stamps, options, reasons of failures, containers, hooks of tests.
// It may include nothing.
//
// Stamps: times in nanoseconds.
//
// Thread safety: values.
#pragma once

#include <cstdint>
#include <limits>

namespace ztf {

using Stamp = std::int64_t;  // nanoseconds

// No stamp. In a query: no time given, so the latest. As a link's stamp on a path: the link is
// static. In a failure: the field does not apply. No row has this stamp (commits/validation.hpp).
constexpr Stamp kNoStamp = std::numeric_limits<Stamp>::min();

// Returns the time from `from` to `to`, in ns. Requires from <= to. Cannot overflow.
inline std::uint64_t span_ns(Stamp from, Stamp to) noexcept {
  return static_cast<std::uint64_t>(to) - static_cast<std::uint64_t>(from);
}

}  // namespace ztf
