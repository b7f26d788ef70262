// Names and authorities whose ids pass to others.
//
// Thread safety: both functions require the topology mutex, and that no frame is locked.
#pragma once

#include "tree_state.hpp"

namespace ztf {

// Frees the ids of all removed names, for new ones. Throws bad_alloc.
void free_removed_names(TreeState& tree);
// Makes room for a new authority: frees those that own no frame, up to half of all, the least
// recently used first. Throws bad_alloc.
void free_authorities(TreeState& tree);

}  // namespace ztf
