// The folder `estimates/`: poses beyond the newest samples, and how wrong they may be.
// In: the samples of a path, as a reader copies them. Out: a pose with bounds of its errors.
// It may include base, geometry, reads.
//
// The question and its answer. How it is answered: PathNow copies the newest samples of the path
// (estimates/path.hpp), copy_cases() what the same question would have had at past instants
// (estimates/cases.hpp), and backtest() compares what it would have answered with what came
// (estimates/backtest.hpp).
//
// Thread safety: values.
#pragma once

#include "base/small_vector.hpp"
#include "reads/query.hpp"

namespace ztf {

struct EstimateQuery {
  FrameId target, source;  // 0 for an unknown frame
  Stamp stamp;
  Stamp now;      // by the clock of the tree's process: samples of a later stamp are future-dated
  double level;   // above 0 and below 1: the share of errors that the bounds are to hold
  Stamp max_by;   // ns, the farthest that a link may be carried on
  double radius;  // metres, of the body around the source's origin that the bound is to hold for
};

// How a link is carried on beyond its newest sample: held, or by the twist between that sample and
// one that many samples before.
enum class Predictor : std::uint8_t { hold, twist_1, twist_3, twist_6 };
inline constexpr std::size_t kPredictors = 4, kTwists = 3;
inline constexpr std::uint32_t kTwistSteps[kTwists] = {1, 3, 6};

struct CarriedLink {
  FrameId child;
  bool by_twist;
};

// If `failure.code` is not ok, the rest is unspecified.
struct EstimateAnswer {
  enum class Basis : std::uint8_t {
    backtest,
    limits,     // all links that move have declared limits of motion: the bounds are guaranteed
    is_static,  // no link moves
  };

  Failure failure;
  Pose pose;               // X_target_source
  double metres, radians;  // bounds of the errors; infinite without anything to compare with
  double level;            // the share of errors within both bounds
  std::int64_t backtests;  // independent past instants that the bounds rest on
  Basis basis;
  Stamp by;               // ns by which the worst link is carried on
  FrameId parent, child;  // of the link that adds most to the error; 0 if none does
  SmallVector<CarriedLink, 16> carried;
};

}  // namespace ztf
