// The tree as a whole, and the writes that drop samples: clear(), reset() and remove_frame().
#include "tree.hpp"

#include <algorithm>

#include "commit_validation.hpp"
#include "history_insert.hpp"
#include "write_locks.hpp"

namespace ztf {

namespace {

// A tree has more ids than frames. So at the limit of frames, too, ids are freed only after many
// removals, and each bears a small part of what it costs to look at all frames (tree_names.cpp).
std::uint32_t most_ids(const Options& options) noexcept {
  return options.max_frames + options.max_frames / 16;
}

}  // namespace

Tree::Tree(const Options& options)
    : options_(options),
      frame_array_(most_ids(options) + 1),
      frames_(frame_array_.begin()),
      ring_arena_(options.max_memory_bytes),
      empty_ring_(Ring::make_empty(ring_arena_)),
      events_(most_ids(options) + 1),
      waiters_(most_ids(options) + 1),
      topology_index_(most_ids(options) + 1),
      authority_counters_(options.max_authorities),
      names_(most_ids(options)),
      authorities_(options.max_authorities) {}

std::unique_lock<std::mutex> Tree::lock_giant() const {
  return options_.concurrency == Concurrency::giant ? lock_announced(giant_)
                                                    : std::unique_lock<std::mutex>();
}

void Tree::list_frames(FrameList& all) const {
  for (FrameId id = 1; id <= names_.size(); ++id) all.push_back(id);
}

void Tree::clear_frame(FrameId id) noexcept {
  const FrameId parent = frames_[id].parent.load(std::memory_order_relaxed);
  if (parent != 0) topology_index_.unlink(id, parent);
  clear_history(frames_[id]);
}

void Tree::drop_samples(const FrameList& frames, bool keep_static, FrameList& dropped) noexcept {
  for (const FrameId id : frames) {
    Frame& frame = frames_[id];
    const bool has_data = frame.parent.load(std::memory_order_relaxed) != 0;
    if (!has_data || (keep_static && frame.is_static.load(std::memory_order_relaxed))) continue;
    clear_frame(id);
    dropped.push_back(id);
  }
}

void Tree::notify_waiters_of(const FrameList& changed) const noexcept {
  if (wait_list_.size() == 0) return;
  for (const FrameId frame : changed)
    if (has_waiters(frame)) wait_list_.notify_frame(frame, WaitList::Change::other);
}

void Tree::clear(bool keep_static, std::int64_t expires_ns) {
  const auto giant = lock_giant();
  FrameList all, dropped;
  {
    const auto topology = lock_announced(topology_);
    list_frames(all);
    (void)dropped.reserve(all.size());  // before the first write, after which nothing may fail
    WriteLocks locks(*this, all);
    check_not_expired(expires_ns);
    locks.begin_write();
    drop_samples(all, keep_static, dropped);
    locks.release(dropped);
  }
  commit_count_.add();
  notify_waiters_of(dropped);
}

void Tree::reset(std::int64_t expires_ns) {
  const auto giant = lock_giant();
  FrameList all;
  {
    const auto topology = lock_announced(topology_);  // no name is added meanwhile
    list_frames(all);
    drop_frames(all, expires_ns);
  }
  commit_count_.add();
  notify_waiters_of(all);
}

void Tree::drop_frames(const FrameList& frames, std::int64_t expires_ns) {
  SmallVector<Ring, 16> rings;
  (void)rings.reserve(frames.size());  // before the first write, after which nothing may fail
  WriteLocks locks(*this, frames);
  check_not_expired(expires_ns);
  locks.begin_write();
  for (const FrameId id : frames) {
    Frame& frame = frames_[id];
    clear_frame(id);
    topology_index_.set_height(id, 0);  // its children are gone, too
    frame.authority.store(0, std::memory_order_release);
    if (const Ring ring = frame.ring.load(std::memory_order_relaxed); ring && !ring.is_empty()) {
      rings.push_back(ring);
      frame.ring.store(empty_ring_, std::memory_order_release);
    }
    names_.hide(id);
  }
  locks.release(frames);
  for (const Ring ring : rings) ring.give_back(ring_arena_);
}

// Lists a frame and, if it has children, its descendants, ascending. Requires the topology mutex.
// Throws Rejected if the frame is unknown, or has children and `subtree` is false.
void Tree::list_subtree(std::string_view name, bool subtree, FrameList& frames) const {
  const FrameId id = names_.find(name);
  if (id == 0)
    throw Rejected{.code = Code::lookup,
                   .message = "frame " + quoted(name) + " does not exist",
                   .frame = std::string(name)};
  frames.push_back(id);
  for (std::size_t i = 0; i < frames.size(); ++i)  // the loop appends to `frames`
    for (FrameId child = topology_index_.first_child(frames[i]); child != 0;
         child = topology_index_.next_sibling(child)) {
      if (!subtree) {
        const std::string child_name = names_.name(child);
        throw Rejected{.code = Code::invalid_argument,
                       .message = "cannot remove frame " + quoted(name) + ": it is the parent of " +
                                  quoted(child_name) + "; remove that first, or the whole subtree",
                       .frame = child_name,
                       .parent = std::string(name),
                       .field = "name"};
      }
      frames.push_back(child);
    }
  std::sort(frames.begin(), frames.end());
}

void Tree::remove_frame(std::string_view name, bool subtree, std::int64_t expires_ns) {
  const auto giant = lock_giant();
  FrameList removed;
  {
    const auto topology = lock_announced(topology_);  // no newest parent changes
    list_subtree(name, subtree, removed);
    drop_frames(removed, expires_ns);
  }
  commit_count_.add();
  notify_waiters_of(removed);
}

}  // namespace ztf
