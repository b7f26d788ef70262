// The tree as a whole, and the writes that drop samples: clear(), reset() and remove_frame().
#include "tree.hpp"

#include <algorithm>

#include "base/host.hpp"
#include "commits/validation.hpp"
#include "commits/write_locks.hpp"
#include "histories/insert.hpp"

namespace ztf {

Tree::Tree(const Options& options)
    : options_(options),
      region_(options),
      frames_(region_.frames()),
      ring_arena_(region_, options.max_memory_bytes),
      events_(region_.events()),
      waiters_(options.max_ids() + 1),
      edits_(options.max_ids() + 1),
      topology_index_(options.max_ids() + 1),
      authority_counters_(options.max_authorities),
      ever_reparented_(region_.header().ever_reparented),
      ids_freed_(region_.header().ids_freed),
      names_(region_.header().names, region_.names(), options.max_ids(), region_),
      authorities_(region_.header().authorities, region_.authorities(), options.max_authorities,
                   region_),
      change_log_(options.max_log_bytes != 0 ? std::make_unique<ChangeLog>(options.max_log_bytes)
                                             : nullptr) {}

// The clock is read before the store: a thread that is stopped in between promises too little.
void Tree::begin_lease(std::int64_t duration_ns) noexcept {
  const std::int64_t until = duration_ns > 0 ? monotonic_ns() + duration_ns : 0;
  region_.header().lease_ns.store(until, std::memory_order_seq_cst);
}

bool Tree::extend_lease(std::int64_t duration_ns) noexcept {
  std::atomic<std::int64_t>& lease = region_.header().lease_ns;
  const std::int64_t now = monotonic_ns();
  if (now >= lease.load(std::memory_order_relaxed)) return false;
  lease.store(now + duration_ns, std::memory_order_seq_cst);
  return true;
}

std::unique_lock<std::mutex> Tree::lock_giant() const {
  return options_.concurrency == Concurrency::giant ? lock_announced(giant_)
                                                    : std::unique_lock<std::mutex>();
}

void Tree::list_frames(FrameList& all) const {
  for (FrameId id = 1; id <= names_.size(); ++id) all.push_back(id);
}

void Tree::clear_frame(FrameId id) noexcept {
  clear_history(frames_[id]);
  frames_[id].authority.store(0, std::memory_order_release);  // it is the link's
  increment(edits_[id]);
}

bool Tree::is_cleared(FrameId id, bool keep_static) const noexcept {
  const auto relaxed = std::memory_order_relaxed;
  const bool has_data = frames_[id].parent.load(relaxed) != 0;
  return has_data && !(keep_static && frames_[id].is_static.load(relaxed));
}

void Tree::drop_samples(const FrameList& frames, bool keep_static, FrameList& dropped) noexcept {
  for (const FrameId id : frames) {
    if (!is_cleared(id, keep_static)) continue;
    clear_frame(id);
    dropped.push_back(id);
  }
}

// Updates the topology index once the samples of `dropped` are. It does what is cheaper: to cut
// their links, or to link what is left. Requires the topology mutex.
void Tree::cut_links(const FrameList& dropped) noexcept {
  const auto parent_of = [&](FrameId id) {
    return frames_[id].parent.load(std::memory_order_relaxed);
  };
  std::size_t left = 0;
  for (FrameId id = 1; id <= names_.size(); ++id) left += parent_of(id) != 0;
  if (dropped.size() <= left) {
    for (const FrameId id : dropped) topology_index_.cut(id);
    return;
  }
  for (FrameId id = 1; id <= names_.size(); ++id) topology_index_.forget(id);
  for (FrameId id = 1; id <= names_.size(); ++id)
    if (const FrameId parent = parent_of(id); parent != 0) topology_index_.link(id, parent);
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
    LogTicket ticket(change_log_.get());
    WriteLocks locks(*this, all);
    log_clear(ticket, locks, keep_static);
    check_not_expired(expires_ns);
    locks.begin_write();
    ticket.draw();
    drop_samples(all, keep_static, dropped);
    locks.release(dropped);
    ticket.publish();
    cut_links(dropped);
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
    for (const FrameId id : all) topology_index_.forget(id);
  }
  commit_count_.add();
  notify_waiters_of(all);
}

void Tree::drop_frames(const FrameList& frames, std::int64_t expires_ns) {
  SmallVector<Ring, 16> rings;
  (void)rings.reserve(frames.size());  // before the first write, after which nothing may fail
  LogTicket ticket(change_log_.get());
  WriteLocks locks(*this, frames);
  log_removal(ticket, locks);
  check_not_expired(expires_ns);
  locks.begin_write();
  ticket.draw();
  for (const FrameId id : frames) {
    Frame& frame = frames_[id];
    clear_frame(id);
    if (const Ring ring = frame.ring.load(std::memory_order_relaxed)) {
      rings.push_back(ring);
      frame.ring.store(Ring(), std::memory_order_release);
    }
    names_.hide(id);
  }
  locks.release(frames);
  ticket.publish();
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
  if (const FrameId child = topology_index_.first_child(id); child != 0 && !subtree) {
    const std::string child_name = names_.name(child);
    throw Rejected{.code = Code::invalid_argument,
                   .message = "cannot remove frame " + quoted(name) + ": it is the parent of " +
                              quoted(child_name) + "; remove that first, or the whole subtree",
                   .frame = child_name,
                   .parent = std::string(name),
                   .field = "name"};
  }
  topology_index_.visit_subtree(id, [&](FrameId frame) { frames.push_back(frame); });
  std::sort(frames.begin(), frames.end());
}

void Tree::remove_frame(std::string_view name, bool subtree, std::int64_t expires_ns) {
  const auto giant = lock_giant();
  FrameList removed;
  {
    const auto topology = lock_announced(topology_);  // no newest parent changes
    list_subtree(name, subtree, removed);
    const FrameId top = names_.find(name);
    drop_frames(removed, expires_ns);
    topology_index_.cut(top);
    for (const FrameId id : removed) topology_index_.forget(id);
  }
  commit_count_.add();
  notify_waiters_of(removed);
}

}  // namespace ztf
