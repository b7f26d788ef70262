// How the frames on the paths are found.
#include "replication/interest_paths.hpp"

#include <algorithm>
#include <unordered_set>
#include <utility>

namespace ztf {

namespace {

constexpr auto kAcquire = std::memory_order_acquire;

}  // namespace

void InterestPaths::find(std::size_t max_frames) {
  ids_freed_ = tree_.ids_freed.load(kAcquire);
  links_.clear();
  wanted_.clear();
  frames_.clear();
  reads_.clear();
  refs_.clear();
  if (pairs_.empty()) {
    size_ = tree_.names.size();
    for (FrameId id = 1; id <= size_; ++id) {
      // Before it is known whether the frame has a name: one that gets or loses it gets a version.
      reads_.push_back({id, tree_.frames[id].version.read_begin()});
      if (!tree_.removed(id)) frames_.push_back(id);
    }
    return;
  }
  for (const auto& [target, source] : pairs_) {
    refs_.push_back(tree_.names.find_ref(target));
    refs_.push_back(tree_.names.find_ref(source));
  }
  for (std::size_t i = 0; i < refs_.size() && frames_.size() <= max_frames; i += 2)
    add_paths(refs_[i].id, refs_[i + 1].id);
  for (const FrameId id : frames_) link(id);  // also of one whose partner does not exist
  // Those above the common ancestors and the removed past parents, too: that they do not lead to
  // more frames must be the tree's state at the same instant.
  for (const auto& [id, link] : links_) reads_.push_back({id, link.version});
}

bool InterestPaths::is_valid() const {
  for (const ReadVersion& read : reads_)
    if (tree_.version(read.frame) != read.version) return false;
  if (tree_.ids_freed.load(kAcquire) != ids_freed_) return false;
  if (pairs_.empty()) return tree_.names.size() == size_;
  for (std::size_t i = 0; i < refs_.size(); ++i)
    if (!(tree_.names.find_ref(name(i)) == refs_[i])) return false;
  return true;
}

void InterestPaths::keep() {
  kept_refs_ = refs_;
  watched_.clear();
  for (const auto& [id, link] : links_)
    if (!wanted_.contains(id)) watched_.emplace_back(id, link);
}

bool InterestPaths::may_differ() const {
  if (kept_refs_.empty()) return true;
  for (const auto& [id, before] : watched_) {
    const Link now = read_link(id);
    if (now.parent != before.parent || now.has_several_parents != before.has_several_parents ||
        now.is_removed != before.is_removed)
      return true;
  }
  for (std::size_t i = 0; i < kept_refs_.size(); ++i)
    if (kept_refs_[i].id == 0 && tree_.names.find(name(i)) != 0) return true;
  return false;
}

void InterestPaths::add_paths(FrameId a, FrameId b) {
  const auto add = [&](FrameId id) {
    if (wanted_.try_emplace(id, false).second) frames_.push_back(id);
  };
  if (a == 0 || b == 0) {
    if (a + b != 0) add(a + b);
    return;
  }
  std::vector<FrameId> from_a, from_b;
  list_path(a, from_a);
  list_path(b, from_b);
  // Above the common ancestor, too: at a past time its links may lead back to the pair or into a
  // loop, and then the tree finds another chain or another failure than the links below imply.
  const auto is_reparented = [&](FrameId id) { return link(id).has_several_parents; };
  if (std::any_of(from_a.begin(), from_a.end(), is_reparented) ||
      std::any_of(from_b.begin(), from_b.end(), is_reparented)) {
    add_all_ancestors(a);
    add_all_ancestors(b);
    return;
  }
  // Both end at the root, so what they have in common are their ends.
  std::size_t common = 0;
  while (common < std::min(from_a.size(), from_b.size()) &&
         from_a.rbegin()[static_cast<std::ptrdiff_t>(common)] ==
             from_b.rbegin()[static_cast<std::ptrdiff_t>(common)])
    ++common;
  if (common > 1) {  // all but the lowest
    from_a.resize(from_a.size() - (common - 1));
    from_b.resize(from_b.size() - (common - 1));
  }
  for (const std::vector<FrameId>* path : {&from_a, &from_b})
    for (const FrameId id : *path) add(id);
}

// Adds a frame and its ancestors at all times.
void InterestPaths::add_all_ancestors(FrameId start) {
  std::vector<FrameId> open{start};
  while (!open.empty()) {
    const FrameId id = open.back();
    open.pop_back();
    const auto [at, is_new] = wanted_.try_emplace(id, false);
    if (is_new) frames_.push_back(id);
    if (std::exchange(at->second, true)) continue;  // its parents are there already
    const Link& found = link(id);
    if (found.parent != 0) open.push_back(found.parent);
    if (!found.has_several_parents) continue;
    const Frame& frame = tree_.frames[id];
    const Ring ring = frame.ring.load(kAcquire);
    const std::uint32_t first = frame.first.load(kAcquire), count = frame.count.load(kAcquire);
    if (!ring) continue;  // a torn read, as is an id below that no frame has
    std::unordered_set<FrameId> parents;
    for (std::uint32_t i = 0; i < std::min(count, ring.capacity()); ++i)
      if (const FrameId parent = ring.parent(first + i);
          parent != 0 && parent <= tree_.names.size())
        parents.insert(parent);
    for (const FrameId parent : parents)
      if (!link(parent).is_removed) open.push_back(parent);
  }
}

// The frame's newest link, read once.
const InterestPaths::Link& InterestPaths::link(FrameId id) {
  const auto [at, is_new] = links_.try_emplace(id);
  if (is_new) at->second = read_link(id);
  return at->second;
}

InterestPaths::Link InterestPaths::read_link(FrameId id) const {
  const Frame& frame = tree_.frames[id];
  return frame.version.read_consistent([&](Version version) noexcept {
    return Link{version, frame.parent.load(kAcquire),
                frame.count.load(kAcquire) > 1 && frame.parent_changes.load(kAcquire) != 0,
                tree_.removed(id)};  // a frame that gets or loses its name gets a version
  });
}

// Lists a frame and its ancestors along the newest links.
void InterestPaths::list_path(FrameId id, std::vector<FrameId>& path) {
  // A frame that moves meanwhile may be met twice, so the length is bounded.
  for (std::size_t left = tree_.options.max_path() + std::size_t{1}; id != 0 && left > 0; --left) {
    path.push_back(id);
    id = link(id).parent;
  }
}

}  // namespace ztf
