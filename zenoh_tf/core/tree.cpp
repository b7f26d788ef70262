// The tree as a whole, and what drops samples of many frames.
#include "tree.hpp"

#include <algorithm>

#include "history_insert.hpp"
#include "write_locks.hpp"

namespace ztf {

Tree::Tree(const Options& options)
    : options_(options),
      frame_array_(std::size_t{options.max_frames} + 1),
      frames_(frame_array_.begin()),
      events_(std::size_t{options.max_frames} + 1),
      waiters_(std::size_t{options.max_frames} + 1),
      authority_counters_(options.max_authorities),
      names_(options.max_frames),
      authorities_(options.max_authorities) {}

void Tree::list_frames(FrameList& all) const {
  for (FrameId id = 1; id <= names_.size(); ++id) all.push_back(id);
}

void Tree::drop_samples(const FrameList& frames, bool keep_static, FrameList& dropped) noexcept {
  for (const FrameId id : frames) {
    Frame& frame = frames_[id];
    const bool has_data = frame.parent.load(std::memory_order_relaxed) != 0;
    if (!has_data || (keep_static && frame.is_static.load(std::memory_order_relaxed))) continue;
    clear_history(frame);
    dropped.push_back(id);
  }
}

void Tree::notify_waiters_of(const FrameList& changed) const {
  if (wait_list_.size() == 0) return;
  for (const FrameId frame : changed)
    if (has_waiters(frame)) wait_list_.notify_frame(frame, WaitList::Change::other);
}

void Tree::clear(bool keep_static) {
  std::unique_lock giant(giant_, std::defer_lock);
  if (options_.concurrency == Concurrency::giant) giant.lock();
  FrameList all, dropped;
  {
    const std::lock_guard topology(topology_);
    list_frames(all);
    (void)dropped.reserve(all.size());  // halfway nothing may fail
    WriteLocks locks(*this, all);
    locks.begin_write();
    drop_samples(all, keep_static, dropped);
    locks.release(dropped);
  }
  count_.add();
  notify_waiters_of(dropped);
}

void Tree::remove_frame(std::string_view name, bool subtree) {
  std::unique_lock giant(giant_, std::defer_lock);
  if (options_.concurrency == Concurrency::giant) giant.lock();
  const auto quoted = [](std::string_view text) {
    return std::string("'").append(text).append("'");
  };
  FrameList gone;
  {
    const std::lock_guard topology(topology_);  // the newest parents stand still
    const FrameId id = names_.find(name);
    if (id == 0)
      throw Rejected{.code = Code::lookup,
                     .message = "frame " + quoted(name) + " does not exist",
                     .frame = std::string(name)};
    gone.push_back(id);
    const auto parent_of = [&](FrameId frame) {
      return frames_[frame].parent.load(std::memory_order_relaxed);
    };
    if (frames_[id].is_parent.load(std::memory_order_relaxed)) {
      std::vector<std::pair<FrameId, FrameId>> links;  // parent, child
      for (FrameId frame = 1; frame <= names_.size(); ++frame)
        if (parent_of(frame) != 0) links.emplace_back(parent_of(frame), frame);
      std::sort(links.begin(), links.end());
      for (std::size_t i = 0; i < gone.size(); ++i) {
        auto link = std::lower_bound(links.begin(), links.end(), std::pair(gone[i], FrameId{0}));
        for (; link != links.end() && link->first == gone[i]; ++link) {
          if (!subtree)
            throw Rejected{.code = Code::invalid_argument,
                           .message = "frame " + quoted(name) + " is the parent of " +
                                      quoted(names_.name(link->second)) +
                                      ": remove that first, or the whole subtree",
                           .frame = std::string(names_.name(link->second)),
                           .parent = std::string(name),
                           .field = "name"};
          gone.push_back(link->second);
        }
      }
    }
    std::sort(gone.begin(), gone.end());
    WriteLocks locks(*this, gone);
    locks.begin_write();
    for (const FrameId frame : gone) {
      clear_history(frames_[frame]);
      frames_[frame].authority.store(0, std::memory_order_release);
      names_.hide(frame);
    }
    locks.release(gone);
  }
  count_.add();
  notify_waiters_of(gone);
}

}  // namespace ztf
