// The folder `commits/`: how a tree is written: all rows of a commit at one instant, or none, but
// for those that the request allows to leave out.
// In: a CommitRequest. Out: new versions of frames and an entry of the change log, or Rejected.
// It may include base, records, histories, tree_state.hpp, modes.
//
// The writes of a tree. Each is applied as a whole at one instant, or throws and changes nothing.
//
// Thread safety: every function, from any thread.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "base/rejected.hpp"
#include "commits/request.hpp"
#include "tree_state.hpp"

namespace ztf {

// Stores all rows, or throws Rejected or bad_alloc and stores none. Sets stored[i] to what it did
// with row i (RowResult): only drop_old and drop_bad allow that a row is not stored. Requires
// stored.size() >= request.rows.size().
void commit(TreeState& tree, const CommitRequest& request, std::span<std::uint8_t> stored);

// Returns why a row of a request is refused: the same error, whether the row rejects its commit or
// is refused alone. Requires that `row` is an element of `request.rows`, and that
// RowResult::is_refusal(result), or that it is RowResult::from_future.
[[nodiscard]] Rejected rejection_of(const TreeState& tree, const CommitRequest& request,
                                    const Row& row, std::uint8_t result);

// The next three throw bad_alloc, and Rejected as a commit does if they expire
// (CommitRequest::expires_ns).

// Drops the samples of all frames. Names stay, and static links with keep_static.
void clear(TreeState& tree, bool keep_static, std::int64_t expires_ns);
// Drops all frames with their links, histories and names. Authorities and counters stay. The ids
// pass to new names once no others are left.
void reset(TreeState& tree, std::int64_t expires_ns);
// Drops a frame with its link, history and name, and with `subtree` all its descendants. Throws
// Rejected if it is unknown, or, without `subtree`, has children.
void remove_frame(TreeState& tree, std::string_view name, bool subtree, std::int64_t expires_ns);

}  // namespace ztf
