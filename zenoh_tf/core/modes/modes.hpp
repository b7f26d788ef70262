// The folder `modes/`: what a tree's transactions do in each mode of concurrency control.
// In: attempts to read, and write sets. Out: attempts under a guard; locks beside the SeqLocks.
// It may include base, tree_state.hpp.
//
// The one place that asks which mode a tree has; each mode is a file of its own.
//
// Thread safety: every function, from any thread.
#pragma once

#include "modes/giant.hpp"
#include "modes/optimistic.hpp"
#include "modes/two_phase.hpp"

namespace ztf {

// True if a reader may use an optimistic guard of its own. Else it needs read_transaction().
[[nodiscard]] ZTF_ALWAYS_INLINE bool allows_optimistic_reads(const TreeState& tree) noexcept {
  return tree.options.concurrency == Concurrency::optimistic;
}

// Runs attempt(guard) until it returns true, in mode giant once: until everything that it read was
// the tree's state at one instant. `reads` is then the read set.
template <class Attempt>
void read_transaction(const TreeState& tree, ReadSet& reads, Attempt&& attempt) {
  switch (tree.options.concurrency) {
    case Concurrency::optimistic:
      return Optimistic::read(tree, reads, attempt);
    case Concurrency::two_phase:
      return TwoPhase::read(tree, reads, attempt);
    case Concurrency::giant:
      return Giant::read(tree, reads, attempt);
  }
}

// A writer holds the result until it ends. It locks something only in mode `giant`.
[[nodiscard]] inline std::unique_lock<std::mutex> lock_transaction(const TreeState& tree) {
  return tree.options.concurrency == Concurrency::giant ? Giant::lock(tree)
                                                        : std::unique_lock<std::mutex>();
}

// What a writer locks before the frames' SeqLocks, and unlocks after them. Throws nothing once it
// has locked.
inline void lock_write_set(TreeState& tree, const FrameList& ascending) {
  if (tree.options.concurrency == Concurrency::two_phase) TwoPhase::lock(tree, ascending);
}
inline void unlock_write_set(TreeState& tree, std::span<const ReadVersion> locked) noexcept {
  if (tree.options.concurrency == Concurrency::two_phase) TwoPhase::unlock(tree, locked);
}

}  // namespace ztf
