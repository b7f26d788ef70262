// How changes are applied.
#include "replication/change_replay.hpp"

#include <algorithm>
#include <utility>

#include "commits/freed_names.hpp"
#include "commits/validation.hpp"
#include "commits/write_locks.hpp"

namespace ztf {

void ChangeReplay::apply(const ChangeColumns& changes, Seq last) {
  {
    const auto topology = lock_announced(tree_.topology);
    find_names(changes.names);
    find_authorities(changes.authorities);
    list_targets(changes);
    list_steps(changes);
    prepare(changes);
    WriteLocks locks(tree_, frames_, true);
    locks.begin_write();
    publish(changes);
    std::size_t at = 0;
    locks.release_each([&](FrameId, Version before) noexcept {
      const Target& target = targets_[at++];
      if (target.after == 0) return before;  // unchanged
      Version after = target.after | (before & ~kServerVersion);
      if (after < before) after += kServerVersion + 1;
      return after;
    });
    give_back();
  }
  tree_.replayed.store(last, std::memory_order_release);
  tree_.commit_count.add();
  WaitList& list = tree_.wait_list;
  if (list.size() == 0) return;
  list.notify_frames(frames_);
  for (const std::string_view name : changes.names) list.notify_name(name);
}

// Finds the names' ids, or adds the names. A name that is added is removed until a change says that
// its frame exists: it may be a past parent that was removed.
void ChangeReplay::find_names(std::span<const std::string_view> names) {
  NameTable& table = tree_.names;
  std::size_t unknown = 0, bytes = 0;
  for (const std::string_view name : names)
    if (table.find_any(name) == 0) ++unknown, bytes += name.size();
  if (unknown > table.left()) throw frame_rejection(names.back(), tree_.options.max_frames);
  if (unknown != 0) table.reserve(unknown, bytes);
  ids_.clear();
  for (const std::string_view name : names) {
    FrameId id = table.find_any(name);
    if (id == 0) id = table.insert_removed(name);
    ids_.push_back(id);
  }
}

void ChangeReplay::find_authorities(std::span<const std::string_view> authorities) {
  NameTable& table = tree_.authorities;
  std::size_t unknown = 0;
  for (const std::string_view name : authorities)
    if (!name.empty() && table.find(name) == 0) ++unknown;
  if (unknown > table.left()) free_authorities(tree_);
  authority_ids_.clear();
  for (const std::string_view name : authorities) {
    AuthorityId id = name.empty() ? 0 : table.find(name);
    if (id == 0 && !name.empty()) {
      if (table.left() == 0) reject_authority(name, table.max_size());
      id = table.insert(name);
      tree_.authority_counters.start(id);
    }
    authority_ids_.push_back(id);
  }
}

// Lists the frames that have changes, by id, in which order they are locked.
void ChangeReplay::list_targets(const ChangeColumns& changes) {
  constexpr std::uint32_t kNone = ~std::uint32_t{0};
  target_of_.assign(changes.names.size(), kNone);
  targets_.clear();
  for (const std::uint32_t name : changes.frame) {
    std::uint32_t& at = target_of_[name];
    if (at == kNone) {
      at = static_cast<std::uint32_t>(targets_.size());
      const FrameId id = ids_[name];
      const bool is_live = !tree_.removed(id);
      targets_.push_back({.id = id,
                          .name = name,
                          .begin = 0,
                          .end = 0,
                          .samples = 0,
                          .before = is_live ? tree_.version(id) & kServerVersion : 0,
                          .after = 0,
                          .is_live = is_live,
                          .authority = tree_.frames[id].authority.load(std::memory_order_relaxed),
                          .ring = nullptr,
                          .draft = nullptr});
    }
    ++targets_[at].end;  // so far the number of its changes
  }
  std::sort(targets_.begin(), targets_.end(),
            [](const Target& a, const Target& b) { return a.id < b.id; });
  frames_.clear();
  std::uint32_t begin = 0;
  for (std::uint32_t i = 0; i < targets_.size(); ++i) {
    Target& target = targets_[i];
    target_of_[target.name] = i;
    target.begin = std::exchange(begin, begin + target.end);
    target.end = target.begin;
    frames_.push_back(target.id);
  }
}

// Lists each frame's changes that are new to it. The others are older than the snapshot's frame.
void ChangeReplay::list_steps(const ChangeColumns& changes) {
  steps_.resize(changes.kind.size());
  std::uint32_t samples = 0, orphans = 0;
  for (std::uint32_t i = 0; i < changes.kind.size(); ++i) {
    const ChangeKind kind = changes.kind[i];
    const std::uint32_t row = has_sample(kind)               ? samples++
                              : kind == ChangeKind::orphaned ? orphans++
                                                             : 0;
    Target& target = targets_[target_of_[changes.frame[i]]];
    if (changes.version[i] > target.before) add_step(changes, target, {i, row});
  }
}

void ChangeReplay::add_step(const ChangeColumns& changes, Target& target, Step step) noexcept {
  steps_[target.end++] = step;
  target.after = changes.version[step.change];
  switch (changes.kind[step.change]) {
    case ChangeKind::sample:
      ++target.samples;
      [[fallthrough]];
    case ChangeKind::static_link:
      target.authority = authority_ids_[changes.authority[step.row]];
      [[fallthrough]];
    case ChangeKind::created:
      target.is_live = true;
      break;
    case ChangeKind::removed:
      target.is_live = false;
      [[fallthrough]];
    case ChangeKind::cleared:
      target.authority = 0;
      break;
    case ChangeKind::new_version:
    case ChangeKind::orphaned:
      break;
  }
}

FrameId ChangeReplay::parent_of(const ChangeColumns& changes, std::uint32_t row) const noexcept {
  const std::uint32_t name = changes.parent[row];
  return name != kNoParent ? ids_[name] : FrameId{0};
}

// A history that is written while its readers wait.
class ChangeReplay::InPlace {
 public:
  InPlace(Frame& frame, PreparedRing* ring, const HistoryLimits& limits) noexcept
      : frame_(frame), history_(frame, ring, limits) {}

  void store(Version, const NewSample& sample) noexcept {
    history_.store(sample.stamp, sample.parent, *sample.pose);
  }
  void set_static(const NewSample& link) noexcept {
    ztf::set_static(frame_, link.stamp, link.parent, *link.pose);
  }
  void clear() noexcept { clear_history(frame_); }
  void forget_parent(FrameId parent) noexcept {
    (void)forget_parents(frame_, [&](FrameId id) { return id == parent; });
  }
  void finish() noexcept {}

 private:
  Frame& frame_;
  HistoryWriter history_;
};

// A draft, into which the samples of each commit are stored together, so that they can be merged.
class ChangeReplay::InDraft {
 public:
  explicit InDraft(HistoryDraft& draft) noexcept : draft_(draft) {}

  void store(Version version, const NewSample& sample) {
    if (version != version_) finish();
    version_ = version;
    samples_.push_back(sample);
  }
  void set_static(const NewSample& link) {
    finish();
    draft_.set_static(link.stamp, link.parent, *link.pose);
  }
  void clear() {
    finish();
    draft_.clear();
  }
  void forget_parent(FrameId parent) {
    finish();
    draft_.forget_parent(parent);
  }
  void finish() {
    draft_.store(samples_);
    samples_.clear();
  }

 private:
  HistoryDraft& draft_;
  Version version_ = 0;
  std::vector<NewSample> samples_;  // of the commit that gave the frame this version
};

template <class History>
void ChangeReplay::write(const ChangeColumns& changes, const Target& target,
                         History& history) const {
  for (std::uint32_t i = target.begin; i < target.end; ++i) {
    const auto [change, row] = steps_[i];
    const ChangeKind kind = changes.kind[change];
    switch (kind) {
      case ChangeKind::sample:
      case ChangeKind::static_link: {
        const NewSample sample{changes.stamp[row], parent_of(changes, row), &changes.pose[row]};
        if (kind == ChangeKind::sample)
          history.store(changes.version[change], sample);
        else
          history.set_static(sample);
        break;
      }
      case ChangeKind::cleared:
      case ChangeKind::removed:
        history.clear();
        break;
      case ChangeKind::orphaned:
        if (changes.lost[row] != kNoParent) history.forget_parent(ids_[changes.lost[row]]);
        break;
      case ChangeKind::created:
      case ChangeKind::new_version:
        break;
    }
  }
  history.finish();
}

// Returns whether the changes of a frame take so long that its readers should continue meanwhile:
// they store many samples from nothing, or move many more than they store (should_merge()).
bool ChangeReplay::needs_draft(const ChangeColumns& changes, const Target& target) const {
  constexpr std::uint32_t kFew = 16, kShort = 1024, kMoves = 4;
  const Frame& frame = tree_.frames[target.id];
  const std::uint32_t count = frame.count.load(std::memory_order_relaxed);
  if (target.samples <= kFew && count <= kShort) return false;
  const ChangeKind first = changes.kind[steps_[target.begin].change];
  if (target.samples > kFew &&
      (count == 0 || first == ChangeKind::cleared || first == ChangeKind::removed))
    return true;
  const Stamp newest = frame.latest.stamp.load(std::memory_order_relaxed);
  Stamp oldest = newest;
  std::uint32_t late = 0;
  std::uint64_t moves_left = std::uint64_t{kMoves} * (std::uint64_t{count} + target.samples);
  std::vector<Stamp> newer;  // the stamps after `newest`, ascending
  for (std::uint32_t i = target.begin; i < target.end; ++i) {
    if (changes.kind[steps_[i].change] != ChangeKind::sample) continue;
    const Stamp stamp = changes.stamp[steps_[i].row];
    if (stamp <= newest) {
      oldest = std::min(oldest, stamp);
      ++late;
      continue;
    }
    auto place = newer.end();
    for (; place != newer.begin() && place[-1] > stamp; --place)
      if (moves_left-- == 0) return true;
    newer.insert(place, stamp);
  }
  return should_merge(frame, oldest, late);
}

// Makes the drafts, and the rings that changes in place need: so that publish() is short, and
// cannot fail.
void ChangeReplay::prepare(const ChangeColumns& changes) {
  const auto relaxed = std::memory_order_relaxed;
  const HistoryLimits limits = this->limits();
  rings_.reserve(2 * targets_.size());  // each may also give its ring back; so none of them moves
  try {
    for (Target& target : targets_) {
      if (target.samples == 0) continue;
      const Frame& frame = tree_.frames[target.id];
      if (needs_draft(changes, target)) {
        target.draft = &drafts_.emplace_back(frame, limits, tree_.ring_arena);
        InDraft history(*target.draft);
        write(changes, target, history);
      } else if (needs_larger_ring(frame, frame.count.load(relaxed), target.samples, limits)) {
        rings_.push_back(grown_ring(frame, target.samples, limits, tree_.ring_arena));
        target.ring = &rings_.back();
      }
    }
  } catch (const RingArena::Full&) {
    give_back();
    reject_memory();
  } catch (...) {
    give_back();
    throw;
  }
}

// Returns whether the changes of a frame only add newer samples of the same parent. Requires that
// they are not applied yet.
bool ChangeReplay::only_appends(const ChangeColumns& changes, const Target& target) const {
  const Frame& frame = tree_.frames[target.id];
  const FrameId parent = frame.parent.load(std::memory_order_relaxed);
  Stamp newest = frame.latest.stamp.load(std::memory_order_relaxed);
  for (std::uint32_t i = target.begin; i < target.end; ++i) {
    const auto [change, row] = steps_[i];
    if (changes.kind[change] != ChangeKind::sample || changes.stamp[row] <= newest ||
        parent_of(changes, row) != parent)
      return false;
    newest = changes.stamp[row];
  }
  return !frame.is_static.load(std::memory_order_relaxed);
}

// Applies all changes. Requires prepare(), the frames' write locks, and that readers wait.
void ChangeReplay::publish(const ChangeColumns& changes) noexcept {
  const auto release = std::memory_order_release;
  // Also for a frame that is newer, as in a snapshot that was read after this commit.
  for (const ChangeKind kind : changes.kind)
    if (kind == ChangeKind::new_version) tree_.ever_reparented.store(true);
  const auto replaced = [&](Ring ring) {
    if (!ring) return;
    PreparedRing old{};
    old.ring = ring;
    rings_.push_back(old);  // prepare() has made room
  };
  for (const Target& target : targets_) {
    if (target.after == 0) continue;
    Frame& frame = tree_.frames[target.id];
    if (!only_appends(changes, target)) increment(tree_.edits[target.id]);
    if (target.draft) {
      replaced(target.draft->publish(frame));
    } else {
      InPlace history(frame, target.ring, limits());
      write(changes, target, history);
    }
    frame.authority.store(target.authority, release);
    if (target.is_live) {
      tree_.names.restore(target.id);
      continue;
    }
    tree_.names.remove(target.id);
    tree_.forget_events({&target.id, 1});
    replaced(frame.ring.load(std::memory_order_relaxed));
    frame.ring.store(Ring(), release);
  }
}

// Gives back what no frame has: all of prepare(), or after publish() the rings that were replaced.
void ChangeReplay::give_back() noexcept {
  drafts_.clear();
  for (const PreparedRing& prepared : rings_)
    if (prepared.ring) prepared.ring.give_back(tree_.ring_arena);
  rings_.clear();
}

void ChangeReplay::reject_memory() const {
  const std::uint64_t limit = tree_.options.max_memory_bytes;
  throw Rejected{.code = Code::limit,
                 .message = "the mirror has no memory for more samples (max_memory)",
                 .field = "max_memory",
                 .limit = static_cast<std::int64_t>(limit)};
}

}  // namespace ztf
