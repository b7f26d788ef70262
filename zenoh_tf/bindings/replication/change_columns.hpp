// Columns of changes and of snapshots as Python's.
//
// GIL: required.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "bindings/bindings.hpp"
#include "replication/change_replay.hpp"

namespace ztf {

template <class T>
nb::object array_of(const std::vector<T>& values) {
  return make_array<T>({values.size()}, [&](T* d) { std::copy(values.begin(), values.end(), d); });
}

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

template <class Text>
nb::list texts_of(const std::vector<Text>& texts) {
  nb::list out;
  for (const Text& text : texts) out.append(nb::str(text.data(), text.size()));
  return out;
}

// (names, authorities, kind, frame, version, parent, authority, stamp, pose, lost): what
// ChangeReplay applies. The batch has the other columns.
template <class Batch, class Texts>
nb::object changes_of(const Batch& batch, const Texts& names, const Texts& authorities) {
  return nb::make_tuple(texts_of(names), texts_of(authorities), kinds_of(batch.kind),
                        array_of(batch.frame), array_of(batch.version), array_of(batch.parent),
                        array_of(batch.authority), array_of(batch.stamp), poses_of(batch.pose),
                        array_of(batch.lost));
}

}  // namespace ztf
