// Columns of changes and of snapshots as Python's.
//
// GIL: required.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "bindings/bindings.hpp"
#include "replication/columns.hpp"

namespace ztf {

inline nb::object kinds_of(const std::vector<ChangeKind>& kinds) {
  return make_array<std::uint8_t>({kinds.size()}, [&](std::uint8_t* d) {
    for (const ChangeKind kind : kinds) *d++ = static_cast<std::uint8_t>(kind);
  });
}

inline nb::object poses_of(const std::vector<Pose>& poses) {
  return make_array<double>({poses.size(), 7}, [&](double* d) {
    for (const Pose& pose : poses) d = std::copy_n(&pose.x, 7, d);
  });
}

inline nb::list texts_of(std::span<const std::string_view> texts) {
  nb::list out;
  for (const std::string_view text : texts) out.append(str_of(text));
  return out;
}

// The arguments of ChangeReplay::apply(): (names, authorities, kind, frame, version, parent,
// authority, stamp, pose, lost).
inline nb::object python_of(const ChangeTable& t) {
  return nb::make_tuple(texts_of(t.names), texts_of(t.authorities), kinds_of(t.kind),
                        array_of(t.frame), array_of(t.version), array_of(t.parent),
                        array_of(t.authority), array_of(t.stamp), poses_of(t.pose),
                        array_of(t.lost));
}

// The arguments of ChangeReplay::load().
inline nb::object python_of(const FrameTable& t) {
  return nb::make_tuple(texts_of(t.names), texts_of(t.authorities), array_of(t.frame),
                        array_of(t.version), array_of(t.is_static), array_of(t.authority),
                        array_of(t.count), array_of(t.stamp), array_of(t.parent), poses_of(t.pose));
}

}  // namespace ztf
