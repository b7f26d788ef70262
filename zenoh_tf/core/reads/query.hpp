// The folder `reads/`: how a query is answered, in any memory and under any concurrency control.
// In: a query, frames, and a guard that validates what was read. Out: an answer or a failure.
// It may include base, geometry, records, histories.
//
// Queries of the tree and their answers, without names and without Python.
//
// Thread safety: values.
#pragma once

#include "base/code.hpp"
#include "histories/gap.hpp"

namespace ztf {

enum class Op : std::uint8_t {
  at = 0,             // at Query::stamp
  latest_common = 1,  // at the latest common time
  latest = 2,         // the newest sample of every link, each link consistent by itself
  latest_xact = 3,    // the newest sample of every link at one instant
  common_time = 4,    // only the latest common time
  full = 5,           // source at source_stamp, target at stamp, through fixed
};
constexpr std::uint8_t kOps = 6;

struct Query {
  Op op = Op::latest_common;
  FrameId target = 0, source = 0;  // 0 for an unknown frame
  // The time of the target. `at` requires one. kNoStamp means the latest common time in `full`, and
  // the newest links in chain(). The others ignore it.
  Stamp stamp = kNoStamp;
  FrameId fixed = 0;              // `full` only: the frame that the two lookups have in common
  Stamp source_stamp = kNoStamp;  // `full` only: the time of the source, kNoStamp as above
  // The most ns between two samples that `at`, `latest_common` and `full` interpolate over, or one
  // of the limits of histories/gap.hpp.
  Stamp max_gap = kNoGapLimit;
};

// A lookup at a time.
inline Query query_at_time(FrameId target, FrameId source, Stamp stamp, Stamp max_gap) noexcept {
  return {.op = Op::at, .target = target, .source = source, .stamp = stamp, .max_gap = max_gap};
}

// Why there is no transform. The other fields mean something only if `code` is not ok; then those
// that do not apply are 0 or kNoStamp.
struct Failure {
  Code code = Code::ok;
  bool source_half = false;                  // of `full`: between the source and the fixed frame
  FrameId target = 0, source = 0;            // of the walk that failed
  FrameId frame = 0, parent = 0;             // the offending link: child and parent
  FrameId target_root = 0, source_root = 0;  // connectivity: where the two paths end
  Stamp stamp = kNoStamp;                    // the requested time; kNoStamp: the newest links
  // Of the offending link's history; of a gap: the samples around it.
  Stamp oldest = kNoStamp, newest = kNoStamp;
  Stamp max_gap = kNoGapLimit;  // of a gap: the limit that it exceeds
  // How often ids had been freed when all these belonged to the frames that were read.
  std::uint64_t ids_freed = 0;

  bool operator==(const Failure&) const = default;
};

// A link that has no sample yet at the time that a lookup asked for (lookups/late.hpp).
struct LateLink {
  FrameId frame = 0;  // its child; 0: none
  Stamp asked = kNoStamp, newest = kNoStamp;
  std::uint64_t ids_freed = 0;  // as in Failure
};

// If `failure.code` is not ok, the pose and the stamps are unspecified.
struct Answer {
  Failure failure = {};
  Pose pose = {};  // X_target_source
  // The time of the pose; for latest and latest_xact: the oldest stamp used. If all links are
  // static, it is kNoStamp for common_time and 0 for the other lookups of newest samples.
  Stamp stamp = 0;
  Stamp newest = 0;  // for latest and latest_xact only: the newest stamp used
  Stamp gap = 0;     // ns, the longest gap that the pose was interpolated over (histories/gap.hpp)
};

// The frames, and the times between which the motion is needed: `at`, and `first` to `last`.
struct MotionQuery {
  FrameId fixed, source;
  Stamp at, first, last;
  Stamp max_gap = kNoGapLimit;  // as of Query
};

// The read set of a transaction may have any size.
inline constexpr std::size_t kNoReadLimit = static_cast<std::size_t>(-1);

// What lookup_motion() has found, if it has not failed.
enum class MotionResult : std::uint8_t {
  copied,
  // The frames may be connected by different paths at different times, or a link has a gap between
  // them. The caller looks up each time by itself.
  varies,
};

}  // namespace ztf
