// Authorities that are forgotten, so that others can take their places.
#include <algorithm>

#include "commits/freed_names.hpp"
#include "commits/write_locks.hpp"

namespace ztf {

// All frames are locked meanwhile. A commit that has looked up an id before, and locks its frames
// afterwards, sees that ids_freed has changed, and looks it up again. No commit
// therefore stores the id of an authority that was forgotten.
void forget_authorities(TreeState& tree) {
  FrameList all;
  tree.list_frames(all);
  // Readers continue, except those of a tree with one frame: its lock begins the write
  // (commits/write_locks.hpp).
  const WriteLocks locks(tree, all);

  const auto relaxed = std::memory_order_relaxed;
  std::vector<bool> owns(tree.authorities.size() + 1);
  for (const FrameId id : all)
    if (tree.frames[id].parent.load(relaxed) != 0)
      owns[tree.frames[id].authority.load(relaxed)] = true;

  std::vector<std::pair<std::uint64_t, AuthorityId>> idle;  // by last use
  for (AuthorityId id = 1; id <= tree.authorities.size(); ++id)
    if (!owns[id]) idle.emplace_back(tree.authority_counters.sum(id).last_used, id);
  std::sort(idle.begin(), idle.end());
  idle.resize(std::min<std::size_t>(idle.size(), (tree.authorities.size() + 1) / 2));
  if (idle.empty()) return;

  std::vector<bool> forgotten(tree.authorities.size() + 1);
  for (const auto& [last_used, id] : idle) forgotten[id] = true;
  // No word may keep an id that another authority will get.
  for (const FrameId id : all) {
    if (forgotten[tree.frames[id].authority.load(relaxed)])
      tree.frames[id].authority.store(0, std::memory_order_release);
    if (std::atomic<AuthorityId>& last = tree.events[id].change_authority;
        forgotten[last.load(relaxed)])
      last.store(0, std::memory_order_release);
  }
  tree.ids_freed.fetch_add(1, std::memory_order_seq_cst);
  for (const auto& [last_used, id] : idle) tree.authorities.remove(id);
}

}  // namespace ztf
