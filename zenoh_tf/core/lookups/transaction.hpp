// Read-only transactions of a tree. Included only by the files that implement its lookups.
//
// Thread safety: any thread.
#pragma once

#include "lookups/lookup.hpp"
#include "modes/modes.hpp"
#include "reads/any_tree.hpp"
#include "reads/reader.hpp"

namespace ztf {

template <class Guard>
ZTF_ALWAYS_INLINE Reader<Guard, FrameAccess> reader_of(const TreeState& tree,
                                                       Guard& guard) noexcept {
  return {FrameAccess(tree.frames), guard, tree.options.max_path(), tree.ever_reparented,
          tree.ids_freed};
}

// Runs body(reader) until everything that it read was the tree's state at one instant. `reads` is
// then the read set.
template <class Body>
void read(const TreeState& tree, ReadSet& reads, Body&& body) {
  read_transaction(tree, reads, [&](auto& guard) {
    Reader reader = reader_of(tree, guard);
    return body(reader) && guard.validate_all();
  });
}

}  // namespace ztf
