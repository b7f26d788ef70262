// Copying a motion out of a tree.
#include "lookups/transaction.hpp"
#include "shared/transaction.hpp"

namespace ztf {

MotionResult lookup_motion(const TreeState& tree, const MotionQuery& query, Motion& motion,
                           Answer& answer) {
  ReadSet reads;
  MotionResult result{};
  read(tree, reads,
       [&](auto& reader) { return reader.copy_motion(query, motion, result, answer); });
  return result;
}

MotionResult SharedTree::lookup_motion(const MotionQuery& query, Motion& motion,
                                       Answer& answer) const {
  ReadSet reads;
  MotionResult result{};
  read(reads, [&](auto& reader) { return reader.copy_motion(query, motion, result, answer); });
  return result;
}

}  // namespace ztf
