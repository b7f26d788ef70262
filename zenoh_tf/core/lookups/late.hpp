// Counts lookups that asked for a time before a link's sample had come, for that link.
//
// The tree counts nothing by itself: its user says which lookups count.
//
// Thread safety: every function, from any thread. A count may be lost if the frame is removed
// meanwhile.
#pragma once

#include "tree_state.hpp"

namespace ztf {

// A time that is further ahead of the newest sample, or of the clock, does not count: then the
// question is wrong or the asker's clock is, and the link is not to blame.
constexpr std::uint64_t kMostLateNs = 10'000'000'000;
constexpr std::int64_t kMostAheadNs = 100'000'000;

// What became of a late lookup.
enum class Late : std::uint8_t { failed, waited };

// Returns the link that a failed lookup lacks a sample of: of those between its frames, by the
// newest parents, the one whose newest sample is the oldest. An error may name another one, as it
// has the first that the walk came to, also above the common ancestor. The frame is 0 if the lookup
// failed for another reason. Throws bad_alloc.
[[nodiscard]] LateLink find_late_link(const TreeState& tree, const Failure& failure);

// Counts a lookup for its late link, if there is one and the time asked for is plausible.
// `asked_at_ns` is the real-time clock when it was asked.
void count_late(const TreeState& tree, const LateLink& link, std::int64_t asked_at_ns,
                Late late) noexcept;

}  // namespace ztf
