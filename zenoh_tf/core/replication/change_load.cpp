// How the pieces of a snapshot are loaded.
#include "replication/change_replay.hpp"

namespace ztf {

void ChangeReplay::load(const FrameColumns& frames) {
  const auto topology = lock_announced(tree_.topology);
  find_names(frames.names);
  find_authorities(frames.authorities);
  std::size_t first = 0;
  for (std::size_t i = 0; i < frames.frame.size(); first += frames.count[i++])
    load_frame(frames, i, first);
}

void ChangeReplay::load_frame(const FrameColumns& frames, std::size_t i, std::size_t first) {
  const FrameId id = ids_[frames.frame[i]];
  Frame& frame = tree_.frames[id];
  const bool is_live = !tree_.removed(id);
  if (is_live && tree_.version(id) >= frames.version[i]) return;

  const std::uint32_t count = frames.count[i];
  const auto sample = [&](std::size_t row) {
    const std::uint32_t parent = frames.parent[row];
    return NewSample{frames.stamp[row], parent < ids_.size() ? ids_[parent] : FrameId{0},
                     &frames.pose[row]};
  };
  HistoryDraft draft(frame, limits(), tree_.ring_arena);
  draft.clear();
  if (count != 0 && frames.is_static[i]) {
    const NewSample link = sample(first);
    draft.set_static(link.stamp, link.parent, *link.pose);
  } else {
    std::vector<NewSample> samples;
    samples.reserve(count);
    for (std::size_t row = first; row < first + count; ++row) samples.push_back(sample(row));
    try {
      draft.store(samples);
    } catch (const RingArena::Full&) {
      reject_memory();
    }
  }
  (void)frame.version.lock_and_begin_write();
  const Ring replaced = draft.publish(frame);
  frame.authority.store(authority_ids_[frames.authority[i]], std::memory_order_release);
  if (frame.parent_changes.load(std::memory_order_relaxed) != 0 && count > 1)
    tree_.ever_reparented.store(true);
  tree_.names.restore(id);
  frame.version.unlock_changed(frames.version[i]);
  if (replaced) replaced.give_back(tree_.ring_arena);
}

}  // namespace ztf
