// What a caller asks of a commit, and what the commit did with each row.
//
// Thread safety: values.
#pragma once

#include <limits>
#include <span>
#include <string_view>

#include "records/frame.hpp"

namespace ztf {

// The expiry of a write that may be applied at any time.
inline constexpr std::int64_t kNeverExpires = std::numeric_limits<std::int64_t>::max();

// One transform to be written. parent and child are indices into CommitRequest::names, and less
// than its size.
struct Row {
  std::uint32_t parent, child;
  Stamp stamp;
  Pose pose;
};

struct CommitRequest {
  std::span<const std::string_view> names;
  std::span<const Row> rows;
  std::string_view authority = {};
  bool is_static = false;
  // Drops rows that are too old, older than all samples of a full frame, or, despite the name,
  // later than `max_stamp`. Without it, one such row rejects the commit.
  bool drop_old = false;
  // The read set: the commit is rejected unless every frame still has the version that was read.
  // Version 0 asserts that the frame does not exist. read_names and read_versions are equally long.
  std::span<const std::string_view> read_names = {};
  std::span<const Version> read_versions = {};
  // The commit is rejected if it would be applied at this time of CLOCK_MONOTONIC or later. The
  // clock is read once nothing is left to wait for.
  std::int64_t expires_ns = kNeverExpires;
  // A dynamic row with a later stamp rejects the commit. With `drop_old` the row is dropped, as if
  // it were not there: it adds no name.
  Stamp max_stamp = std::numeric_limits<Stamp>::max();
};

// What a commit did with a row.
struct RowResult {
  static constexpr std::uint8_t dropped = 0;  // too old, or older than all of a full frame
  static constexpr std::uint8_t stored = 1;
  static constexpr std::uint8_t from_future = 2;  // dropped: later than CommitRequest::max_stamp
};

}  // namespace ztf
