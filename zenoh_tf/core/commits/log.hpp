// What writes add to the change log beside a commit's rows (CommitExecution::log).
//
// Thread safety: requires the topology mutex and the frames' write locks, and that the first write
// has not begun.
#pragma once

#include "commits/write_locks.hpp"

namespace ztf {

// Fills the ticket's entry with one change without data for each of these frames that has a name.
// Throws bad_alloc.
void log_frames(const TreeState& tree, LogTicket& ticket, const WriteLocks& locks, ChangeKind kind,
                const FrameList& frames);

}  // namespace ztf
