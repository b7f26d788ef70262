// How changes are applied and frames are loaded.
#include "change_replay.hpp"

#include <algorithm>

#include "commit_validation.hpp"
#include "write_locks.hpp"

namespace ztf {

namespace {

HistoryLimits limits_of(const Options& options) noexcept {
  return {options.cache_ns, options.max_samples_per_frame};
}

[[noreturn]] void reject_memory_of(const Options& options) {
  throw Rejected{.code = Code::limit,
                 .message = "the mirror has no memory for more samples (max_memory_bytes)",
                 .field = "max_memory_bytes",
                 .limit = static_cast<std::int64_t>(options.max_memory_bytes)};
}

}  // namespace

void ChangeReplay::apply(const ChangeColumns& changes) {
  {
    const auto topology = lock_announced(tree_.topology_);
    find_names(changes.names);
    find_authorities(changes.authorities);
    list_targets(changes);
    rings_.clear();
    try {
      prepare_rings();
    } catch (...) {
      give_back_rings();
      throw;
    }
    WriteLocks locks(tree_, frames_, true);
    locks.begin_write();
    apply_locked(changes);
    std::size_t at = 0;
    locks.release_each([&](FrameId, Version before) noexcept {
      const Target& target = targets_[at++];
      if (target.after == 0) return before - SeqLock::kIncrement;  // unchanged
      Version after = target.after | (before & ~kServerVersion);
      if (after < before) after += kServerVersion + 1;
      return after - SeqLock::kIncrement;
    });
    give_back_rings();  // those that were replaced
  }
  tree_.replayed_.store(changes.last, std::memory_order_release);
  tree_.commit_count_.add();
  WaitList& list = tree_.wait_list_;
  if (list.size() == 0) return;
  for (const FrameId id : frames_)
    if (tree_.has_waiters(id)) list.notify_frame(id, WaitList::Change::other);
  for (const std::string_view name : changes.names) list.notify_name(name);
}

// Finds the names' ids, or adds the names. A name that is added is hidden until a change says that
// its frame exists: it may be a past parent that was removed.
void ChangeReplay::find_names(std::span<const std::string_view> names) {
  NameTable& table = tree_.names_;
  std::size_t unknown = 0, bytes = 0;
  for (const std::string_view name : names)
    if (table.find_any(name) == 0) ++unknown, bytes += name.size();
  if (unknown > table.left()) reject_frame(names.back(), tree_.options_.max_frames);
  if (unknown != 0) table.reserve(unknown, bytes);
  ids_.clear();
  for (const std::string_view name : names) {
    FrameId id = table.find_any(name);
    if (id == 0) id = table.insert_hidden(name);
    ids_.push_back(id);
  }
}

void ChangeReplay::find_authorities(std::span<const std::string_view> authorities) {
  NameTable& table = tree_.authorities_;
  std::size_t unknown = 0;
  for (const std::string_view name : authorities)
    if (!name.empty() && table.find(name) == 0) ++unknown;
  if (unknown > table.left()) tree_.forget_authorities();
  authority_ids_.clear();
  for (const std::string_view name : authorities) {
    AuthorityId id = name.empty() ? 0 : table.find(name);
    if (id == 0 && !name.empty()) {
      if (table.left() == 0) reject_authority(name, table.max_size());
      id = table.insert(name);
      tree_.authority_counters_.start(id);
    }
    authority_ids_.push_back(id);
  }
}

void ChangeReplay::list_targets(const ChangeColumns& changes) {
  constexpr std::uint32_t kNone = ~std::uint32_t{0};
  target_of_.assign(changes.names.size(), kNone);
  targets_.clear();
  frames_.clear();
  for (std::size_t i = 0; i < changes.frame.size(); ++i) {
    std::uint32_t& at = target_of_[changes.frame[i]];
    if (at == kNone) {
      const FrameId id = ids_[changes.frame[i]];
      const bool is_live = !tree_.removed(id);
      at = static_cast<std::uint32_t>(targets_.size());
      targets_.push_back({id, is_live ? tree_.version(id) & kServerVersion : 0, 0, 0, 0, is_live});
    }
    if (changes.kind[i] == ChangeKind::sample && changes.version[i] > targets_[at].before)
      ++targets_[at].samples;
  }
  // By id, in which order they are locked.
  std::vector<std::uint32_t> order(targets_.size()), place(targets_.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](auto a, auto b) { return targets_[a].id < targets_[b].id; });
  std::vector<Target> sorted;
  sorted.reserve(order.size());
  for (const std::uint32_t i : order) {
    place[i] = static_cast<std::uint32_t>(sorted.size());
    sorted.push_back(targets_[i]);
    frames_.push_back(targets_[i].id);
  }
  targets_.swap(sorted);
  for (std::uint32_t& at : target_of_)
    if (at != kNone) at = place[at];
}

// Makes the rings that the changes need, so that applying them cannot fail.
void ChangeReplay::prepare_rings() {
  const auto relaxed = std::memory_order_relaxed;
  const HistoryLimits limits = limits_of(tree_.options_);
  rings_.reserve(2 * targets_.size());  // each may also give its ring back
  for (Target& target : targets_) {
    const Frame& frame = tree_.frames_[target.id];
    if (target.samples == 0 ||
        !needs_larger_ring(frame, frame.count.load(relaxed), target.samples, limits))
      continue;
    try {
      rings_.push_back(grown_ring(frame, target.samples, limits, tree_.ring_arena_));
    } catch (const RingArena::Full&) {
      reject_memory_of(tree_.options_);
    }
    target.ring = static_cast<std::uint32_t>(rings_.size());
  }
}

void ChangeReplay::apply_locked(const ChangeColumns& changes) noexcept {
  const auto release = std::memory_order_release;
  std::size_t row = 0, orphaned = 0;
  for (std::size_t i = 0; i < changes.kind.size(); ++i) {
    const ChangeKind kind = changes.kind[i];
    const std::size_t this_row = row;
    row += has_sample(kind);
    const std::size_t this_orphaned = orphaned;
    orphaned += kind == ChangeKind::orphaned;
    Target& target = targets_[target_of_[changes.frame[i]]];
    // Also if the frame is newer, as in a snapshot that was read after this commit.
    if (kind == ChangeKind::new_version) tree_.ever_reparented_.store(true);
    if (changes.version[i] <= target.before) continue;
    target.after = changes.version[i];
    Frame& frame = tree_.frames_[target.id];
    switch (kind) {
      case ChangeKind::sample:
      case ChangeKind::static_link:
        store_sample(target, changes, this_row, kind == ChangeKind::static_link);
        [[fallthrough]];
      case ChangeKind::created:
        target.is_live = true;
        tree_.names_.show(target.id);
        break;
      case ChangeKind::cleared:
        clear_history(frame);
        break;
      case ChangeKind::removed:
        clear_history(frame);
        frame.authority.store(0, release);
        target.is_live = false;
        tree_.names_.hide(target.id);
        break;
      case ChangeKind::new_version:
        break;
      case ChangeKind::orphaned:
        if (const std::uint32_t lost = changes.lost[this_orphaned]; lost != kNoParent)
          (void)forget_parents(frame, [&](FrameId id) { return id == ids_[lost]; });
        break;
    }
  }
  for (const Target& target : targets_) {
    Frame& frame = tree_.frames_[target.id];
    if (target.is_live) continue;
    const Ring ring = frame.ring.load(std::memory_order_relaxed);
    if (!ring) continue;
    PreparedRing old{};
    old.ring = ring;
    rings_.push_back(old);  // prepare_rings() has made room
    frame.ring.store(Ring(), release);
  }
}

void ChangeReplay::store_sample(Target& target, const ChangeColumns& changes, std::size_t row,
                                bool is_static) noexcept {
  Frame& frame = tree_.frames_[target.id];
  const std::uint32_t name = changes.parent[row];
  const FrameId parent = name < ids_.size() ? ids_[name] : FrameId{0};
  if (is_static) {
    set_static(frame, changes.stamp[row], parent, changes.pose[row]);
  } else {
    if (target.ring != 0) {
      publish_ring(frame, rings_[target.ring - 1]);
      target.ring = 0;
    }
    (void)insert(frame, changes.stamp[row], parent, changes.pose[row], limits_of(tree_.options_));
  }
  frame.authority.store(authority_ids_[changes.authority[row]], std::memory_order_release);
}

void ChangeReplay::give_back_rings() noexcept {
  for (const PreparedRing& prepared : rings_)
    if (prepared.ring) prepared.ring.give_back(tree_.ring_arena_);
  rings_.clear();
}

void ChangeReplay::load(const FrameColumns& frames) {
  const auto topology = lock_announced(tree_.topology_);
  find_names(frames.names);
  find_authorities(frames.authorities);
  std::size_t first = 0;
  for (std::size_t i = 0; i < frames.frame.size(); first += frames.count[i++])
    load_frame(frames, i, first);
}

void ChangeReplay::load_frame(const FrameColumns& frames, std::size_t i, std::size_t first) {
  const FrameId id = ids_[frames.frame[i]];
  Frame& frame = tree_.frames_[id];
  const bool is_live = !tree_.removed(id);
  if (is_live && tree_.version(id) >= frames.version[i]) return;

  const std::uint32_t count = frames.count[i];
  const auto parent_of = [&](std::size_t sample) {
    const std::uint32_t parent = frames.parent[sample];
    return parent < ids_.size() ? ids_[parent] : FrameId{0};
  };
  PreparedRing prepared{};
  if (count != 0 && !frames.is_static[i]) {
    std::vector<NewSample> samples;
    samples.reserve(count);
    for (std::size_t s = first; s < first + count; ++s)
      samples.push_back({frames.stamp[s], parent_of(s), &frames.pose[s]});
    try {
      prepared = merged_ring(frame, true, samples, limits_of(tree_.options_), tree_.ring_arena_);
    } catch (const RingArena::Full&) {
      reject_memory_of(tree_.options_);
    }
  }
  (void)frame.version.lock_and_begin_write();
  clear_history(frame);
  if (prepared.ring)
    publish_ring(frame, prepared);
  else if (count != 0)
    set_static(frame, frames.stamp[first], parent_of(first), frames.pose[first]);
  frame.authority.store(authority_ids_[frames.authority[i]], std::memory_order_release);
  if (frame.parent_changes.load(std::memory_order_relaxed) != 0 && count > 1)
    tree_.ever_reparented_.store(true);
  tree_.names_.show(id);
  frame.version.unlock_changed(frames.version[i] - SeqLock::kIncrement);
  if (prepared.ring) prepared.ring.give_back(tree_.ring_arena_);
}

}  // namespace ztf
