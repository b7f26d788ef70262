// Authorities that are forgotten, so that others can take their places.
#include <algorithm>

#include "commits/write_locks.hpp"
#include "tree.hpp"

namespace ztf {

// All frames are locked meanwhile. A commit that has looked up an id before, and locks its frames
// afterwards, sees that ids_freed_ has changed, and looks it up again. No commit
// therefore stores the id of an authority that was forgotten.
void Tree::forget_authorities() {
  FrameList all;
  list_frames(all);
  // Readers go on, except of a tree with one frame: its lock begins the write
  // (commits/write_locks.hpp).
  const WriteLocks locks(*this, all);

  const auto relaxed = std::memory_order_relaxed;
  std::vector<bool> owns(authorities_.size() + 1);
  for (const FrameId id : all)
    if (frames_[id].parent.load(relaxed) != 0) owns[frames_[id].authority.load(relaxed)] = true;

  std::vector<std::pair<std::uint64_t, AuthorityId>> idle;  // by last use
  for (AuthorityId id = 1; id <= authorities_.size(); ++id)
    if (!owns[id]) idle.emplace_back(authority_counters_.sum(id).last_used, id);
  std::sort(idle.begin(), idle.end());
  idle.resize(std::min<std::size_t>(idle.size(), (authorities_.size() + 1) / 2));
  if (idle.empty()) return;

  std::vector<bool> forgotten(authorities_.size() + 1);
  for (const auto& [last_used, id] : idle) forgotten[id] = true;
  // No word may keep an id that another authority will get.
  for (const FrameId id : all) {
    if (forgotten[frames_[id].authority.load(relaxed)])
      frames_[id].authority.store(0, std::memory_order_release);
    if (std::atomic<AuthorityId>& last = events_[id].change_authority;
        forgotten[last.load(relaxed)])
      last.store(0, std::memory_order_release);
  }
  ids_freed_.fetch_add(1, std::memory_order_seq_cst);
  for (const auto& [last_used, id] : idle) authorities_.remove(id);
}

}  // namespace ztf
