// From a path and its backtest to the answer.
//
// Thread safety: functions of their arguments.
#pragma once

#include "estimates/backtest.hpp"
#include "estimates/limits.hpp"

namespace ztf {

// Sets why the time is too far beyond the newest sample of a link, if it is.
bool is_too_far(const EstimateQuery& query, const PathNow& path, Failure& failure) noexcept;

// Returns false if no link of the path can be wrong: then there is nothing to backtest. Requires
// the links' errors of clocks.
bool may_err(const PathNow& path) noexcept;

// Sets all of the answer. `backtest` is null if no link can be wrong; `limits` are those of each
// link, or none at all.
void conclude(const EstimateQuery& query, const PathNow& path, const Backtest* backtest,
              std::span<const MotionLimits> limits, EstimateAnswer& answer);

}  // namespace ztf
