// Questions and answers of the tree, without names and without Python.
//
// Thread safety: values.
#pragma once

#include "frame.hpp"

namespace ztf {

// As in zenoh_tf/errors.py, which holds the meaning of each.
enum class Code : std::uint8_t {
  ok = 0,
  lookup = 2,
  connectivity = 3,
  invalid_argument = 4,
  extrapolation = 6,
  no_data = 7,
  backward = 8,
  forward = 9,
  conflict = 10,
  limit = 11,
};

enum class Op : std::uint8_t {
  at = 0,             // at Query::stamp
  latest_common = 1,  // at the latest common time
  latest = 2,         // newest of every link, each link consistent by itself
  latest_xact = 3,    // newest of every link at one instant
  common_time = 4,    // only the latest common time
  full = 5,           // source at source_stamp, target at stamp, through fixed
};
constexpr std::uint8_t kOps = 6;

struct Query {
  Op op;
  FrameId target, source;  // 0: unknown
  Stamp stamp = kNoStamp;  // `full`: kNoStamp means latest common
  FrameId fixed = 0;
  Stamp source_stamp = kNoStamp;
};

// Why there is no transform, in facts.
struct Failure {
  Code code = Code::ok;
  FrameId target = 0, source = 0;            // of the walk that failed
  FrameId frame = 0, parent = 0;             // the offending link: child, parent
  FrameId target_root = 0, source_root = 0;  // connectivity: where the two ways up end
  Stamp stamp = kNoStamp, oldest = kNoStamp, newest = kNoStamp;
};

struct Answer {
  Failure failure = {};
  Pose pose = {};    // X_target_source
  Stamp stamp = 0;   // latest forms: the oldest used
  Stamp newest = 0;  // latest forms only
};

}  // namespace ztf
