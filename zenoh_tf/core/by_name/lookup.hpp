// The folder `by_name/`: what programs ask of a tree, by the frames' names.
// In: names, of a tree of this process or of a shared one. Out: answers that belong to those names,
// or the error that says why there is none.
// It may include base, names, reads, shared, tree.hpp.
//
// One lookup by names.
//
// An id may pass to another name while a lookup of ids runs. So the ids are found again until none
// was freed meanwhile.
//
// Thread safety: every function, from any thread.
#pragma once

#include <string_view>

#include "reads/query.hpp"

namespace ztf {

// Whether a frame can have that name.
[[nodiscard]] inline bool is_frame_name(std::string_view name) noexcept {
  return !name.empty() && name[0] != '/';
}

// A query with its frames' names, which must outlive it. The ids are those that they had last.
struct NamedQuery : Query {
  std::string_view target_name, source_name, fixed_name = {};

  template <class AnyTree>
  void find_ids(const AnyTree& tree) noexcept {
    target = tree.find(target_name);
    source = tree.find(source_name);
    if (op == Op::full) fixed = tree.find(fixed_name);
  }
};

template <class AnyTree>
void lookup(const AnyTree& tree, NamedQuery& query, Answer& answer) {
  (void)tree.read_names([&] {
    query.find_ids(tree);
    tree.lookup(query, answer);
    return true;
  });
}

// The frames from target to source over their common ancestor, at the query's time.
template <class AnyTree>
Failure chain(const AnyTree& tree, NamedQuery& query, std::vector<std::string>& names) {
  return tree.read_names([&] {
    query.find_ids(tree);
    std::vector<FrameId> frames;
    const Failure failure = tree.chain(query, frames);
    names.clear();
    for (const FrameId id : frames) names.push_back(tree.name(id));
    return failure;
  });
}

}  // namespace ztf
