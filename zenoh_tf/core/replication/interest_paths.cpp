// How the frames on the paths are found.
#include <algorithm>
#include <unordered_set>

#include "replication/interest_reader.hpp"

namespace ztf {

// Lists the frames on the paths, until there are more than that.
void InterestReader::find_frames(std::size_t max_frames) {
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
    new_refs_.push_back(tree_.names.find_ref(target));
    new_refs_.push_back(tree_.names.find_ref(source));
  }
  for (std::size_t i = 0; i < new_refs_.size() && frames_.size() <= max_frames; i += 2)
    add_paths(new_refs_[i].id, new_refs_[i + 1].id);
  for (const FrameId id : frames_) link(id);  // also of one whose partner does not exist
  // Those above the common ancestors and the removed past parents, too: that they do not lead to
  // more frames must be the tree's state at the same instant.
  for (const auto& [id, link] : links_) reads_.push_back({id, link.version});
}

void InterestReader::add_paths(FrameId a, FrameId b) {
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
void InterestReader::add_all_ancestors(FrameId start) {
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
    const Ring ring = frame.ring.load(std::memory_order_acquire);
    const std::uint32_t first = frame.first.load(std::memory_order_acquire),
                        count = frame.count.load(std::memory_order_acquire);
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
const InterestReader::Link& InterestReader::link(FrameId id) {
  const auto [at, is_new] = links_.try_emplace(id);
  if (is_new) at->second = read_link(id);
  return at->second;
}

InterestReader::Link InterestReader::read_link(FrameId id) const {
  const Frame& frame = tree_.frames[id];
  return frame.version.read_consistent([&](Version version) noexcept {
    return Link{version, frame.parent.load(std::memory_order_acquire),
                frame.count.load(std::memory_order_acquire) > 1 &&
                    frame.parent_changes.load(std::memory_order_acquire) != 0,
                tree_.removed(id)};  // a frame that gets or loses its name gets a version
  });
}

// Lists a frame and its ancestors along the newest links.
void InterestReader::list_path(FrameId id, std::vector<FrameId>& path) {
  // A frame that moves meanwhile may be met twice, so the length is bounded.
  for (std::size_t left = tree_.options.max_path() + std::size_t{1}; id != 0 && left > 0; --left) {
    path.push_back(id);
    id = link(id).parent;
  }
}

}  // namespace ztf
