// Lengths of time as people read them, and stamps of another clock, or in seconds, milliseconds or
// microseconds, where nanoseconds belong.
//
// A stamp near 0 is ordinary in simulated time. So a unit is only named for a stamp that has
// another one beside it: those of the tree, or the clock's.
//
// Thread safety: every function, from any thread.
#pragma once

#include <string>

#include "base/stamp.hpp"

namespace ztf {

// "850 us", "12 ms", "3.4 s", "5 min", "8.0 h", "6.5 days", "56.9 years".
std::string age(double length_ns);

// The unit of a stamp that should be in nanoseconds; null if it may be in nanoseconds. `oldest` and
// `newest` are the stamps beside it. Read in its unit, the stamp may lie outside of both by a day,
// in simulated time by a minute.
const char* other_unit(Stamp stamp, Stamp oldest, Stamp newest) noexcept;

// What is wrong with the stamp of a transform that is about to be written, if it is the clock's
// time of today in another unit; else empty. Simulated time passes through these stamps, too, but
// in whole microseconds.
std::string unit_warning(const std::string& quoted_child, Stamp stamp, Stamp now);

// What stands behind the error of a lookup at a time that its link has no data for. `waited` says
// how long the lookup has waited, and may be empty; `may_wait`: its method has a time-out.
std::string beside(Stamp stamp, Stamp oldest, Stamp newest, const std::string& waited,
                   bool may_wait);

// When a link has ended that limits a lookup without a time. `newest` is its newest stamp, `oldest`
// the oldest of the link `failing` that the lookup fails at. `change` says what has changed the
// link that ended, and may be empty.
std::string ended(Stamp newest, Stamp oldest, Stamp now, const std::string& failing,
                  const std::string& change);

}  // namespace ztf
