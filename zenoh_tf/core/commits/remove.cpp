// The writes that drop samples or frames: clear(), reset() and remove_frame().
#include <algorithm>
#include <vector>

#include "commits/apply.hpp"
#include "commits/commit.hpp"
#include "histories/insert.hpp"

namespace ztf {

namespace {

// Whether clear() drops the frame's samples. Requires the frame's write lock.
bool is_cleared(const Frame& frame, bool keep_static) noexcept {
  const auto relaxed = std::memory_order_relaxed;
  return frame.parent.load(relaxed) != 0 && !(keep_static && frame.is_static.load(relaxed));
}

// Leaves the frame without samples and without a parent. Requires what clear_history() does.
void clear_frame(TreeState& tree, FrameId id) noexcept {
  clear_history(tree.frames[id]);
  tree.frames[id].authority.store(0, std::memory_order_release);  // it is the link's
  tree.events[id].forget_link();
  increment(tree.edits[id]);
}

// Drops the frames with their names, at one instant. Requires the topology mutex. Throws Rejected
// if it has expired, and bad_alloc.
void drop_frames(TreeState& tree, const FrameList& frames, std::int64_t expires_ns) {
  SmallVector<Ring, 16> rings;
  (void)rings.reserve(frames.size());  // before the first write, after which nothing may fail
  LogTicket ticket(tree.change_log.get());
  WriteLocks locks(tree, frames);
  log_frames(tree, ticket, locks, ChangeKind::removed, frames);
  check_not_expired(expires_ns);
  locks.begin_write();
  ticket.draw();
  for (const FrameId id : frames) {
    Frame& frame = tree.frames[id];
    clear_frame(tree, id);
    if (const Ring ring = frame.ring.load(std::memory_order_relaxed)) {
      rings.push_back(ring);
      frame.ring.store(Ring(), std::memory_order_release);
    }
    tree.names.remove(id);
  }
  tree.forget_events(frames);
  locks.release(frames);
  ticket.publish();
  for (const Ring ring : rings) ring.give_back(tree.ring_arena);
}

// Returns the child with the lowest id; 0 if the frame has none. Requires the topology mutex.
FrameId first_child(const TreeState& tree, FrameId parent) noexcept {
  for (FrameId id = 1; id <= tree.names.size(); ++id)
    if (tree.frames[id].parent.load(std::memory_order_relaxed) == parent) return id;
  return 0;
}

// Lists a frame and all below it, ascending. It walks up from each frame, and no link twice.
// Requires the topology mutex. Throws bad_alloc.
void list_with_descendants(const TreeState& tree, FrameId top, FrameList& frames) {
  enum class Place : std::uint8_t { unknown, below, elsewhere };
  std::vector<Place> places(tree.names.size() + 1);
  places[0] = Place::elsewhere;
  places[top] = Place::below;
  FrameList walked;
  for (FrameId id = 1; id <= tree.names.size(); ++id) {
    walked.clear();
    FrameId at = id;
    for (; places[at] == Place::unknown;
         at = tree.frames[at].parent.load(std::memory_order_relaxed))
      walked.push_back(at);
    for (const FrameId each : walked) places[each] = places[at];
    if (places[id] == Place::below) frames.push_back(id);
  }
}

// Lists a frame and, if it has children, its descendants, ascending. Requires the topology mutex.
// Throws Rejected if the frame is unknown, or has children and `subtree` is false.
void list_subtree(const TreeState& tree, std::string_view name, bool subtree, FrameList& frames) {
  const FrameId id = tree.names.find(name);
  if (id == 0)
    throw Rejected{.code = Code::lookup,
                   .message = "frame " + quoted(name) + " does not exist",
                   .frame = std::string(name)};
  const FrameId child = first_child(tree, id);
  if (child != 0 && !subtree) {
    const std::string child_name = tree.name(child);
    throw Rejected{.code = Code::invalid_argument,
                   .message = "cannot remove frame " + quoted(name) + ": it is the parent of " +
                              quoted(child_name) + "; remove that first, or the whole subtree",
                   .frame = child_name,
                   .parent = std::string(name),
                   .field = "name"};
  }
  if (child != 0)
    list_with_descendants(tree, id, frames);
  else
    frames.push_back(id);
}

}  // namespace

void clear(TreeState& tree, bool keep_static, std::int64_t expires_ns) {
  const auto transaction = lock_transaction(tree);
  FrameList all, dropped;
  {
    const auto topology = lock_announced(tree.topology);
    tree.list_frames(all);
    (void)dropped.reserve(all.size());
    LogTicket ticket(tree.change_log.get());
    WriteLocks locks(tree, all);
    for (const FrameId id : all)
      if (is_cleared(tree.frames[id], keep_static)) dropped.push_back(id);
    log_frames(tree, ticket, locks, ChangeKind::cleared, dropped);
    check_not_expired(expires_ns);
    locks.begin_write();
    ticket.draw();
    for (const FrameId id : dropped) clear_frame(tree, id);
    locks.release(dropped);
    ticket.publish();
  }
  tree.commit_count.add();
  tree.wait_list.notify_frames(dropped);
}

void reset(TreeState& tree, std::int64_t expires_ns) {
  const auto transaction = lock_transaction(tree);
  FrameList all;
  {
    const auto topology = lock_announced(tree.topology);  // no name is added meanwhile
    tree.list_frames(all);
    drop_frames(tree, all, expires_ns);
  }
  tree.commit_count.add();
  tree.wait_list.notify_frames(all);
}

void remove_frame(TreeState& tree, std::string_view name, bool subtree, std::int64_t expires_ns) {
  const auto transaction = lock_transaction(tree);
  FrameList removed;
  {
    const auto topology = lock_announced(tree.topology);  // no newest parent changes
    list_subtree(tree, name, subtree, removed);
    drop_frames(tree, removed, expires_ns);
  }
  tree.commit_count.add();
  tree.wait_list.notify_frames(removed);
}

}  // namespace ztf
