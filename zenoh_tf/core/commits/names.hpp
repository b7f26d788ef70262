// The names of a commit as frame ids.
//
// A name is new if no frame has it now: it never existed, or its frame was removed. A removed name
// comes back with its old id, if it still has one (commits/freed_names.cpp). The others get the
// next ids, in the order of the commit's rows. Only rows that are stored create names (CommitPlan).
//
// Thread safety: lives on the writer's stack. Assigning ids and publishing names require the
// topology mutex: it keeps a new name new, and the next id free.
// Invariant: ids that were found without the mutex, by names or from references that were still
// current, may be stale, which is safe.
// 1. If a frame was removed, and its id is still its own or nobody's: a removed child has no
//    parent, and a removed parent has no children. So the row stores another parent than the child
//    has: CommitPlan::decide() asks for the topology mutex, and the names are looked up again.
// 2. If another name has the id by now: the commit holds the child's lock, and finds that the child
//    has the parent that the row has. One of these two got its id from another name, and then that
//    link. The commit that made the link released the child's lock afterwards, so are_ids_current()
//    is false, and the names are looked up again.
#pragma once

#include <algorithm>
#include <cassert>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "commits/freed_names.hpp"
#include "commits/validation.hpp"

namespace ztf {

// A request with the names of its frames, for texts.
class NamedRequest {
 public:
  NamedRequest(const TreeState& tree, const CommitRequest& request) : request_(request) {
    for (const NameRef& frame : request.frames) texts_.push_back(tree.name(frame.id));
    names_.assign(texts_.begin(), texts_.end());
    if (!names_.empty()) request_.names = names_;
  }
  NamedRequest(const NamedRequest&) = delete;
  NamedRequest& operator=(const NamedRequest&) = delete;
  [[nodiscard]] const CommitRequest& operator*() const noexcept { return request_; }

 private:
  CommitRequest request_;
  std::vector<std::string> texts_;
  std::vector<std::string_view> names_;
};

class CommitNames {
 public:
  CommitNames(TreeState& tree, const CommitRequest& request) : tree_(tree), request_(request) {
    std::string_view* name = names_.append(request.names.size());
    for (const std::string_view as_given : request.names) {
      *name = stripped(as_given);
      all_valid_ &= is_valid_name(*name++, tree.options);
    }
    (void)ids_.append(request.names.size() + request.frames.size());
    ids_freed_ = tree.ids_freed.load(std::memory_order_acquire);
    find();
    // Names that frames have were checked when they were new.
    for (std::size_t i = 0; i < names_.size(); ++i)
      all_valid_ &= ids_[i] != 0 || !has_zero(names_[i]);
    yield_point();
  }

  // True if every name may be a frame's.
  [[nodiscard]] bool all_valid() const noexcept { return all_valid_; }
  // The id of a name of the request; 0 if the name is new.
  [[nodiscard]] FrameId id(std::uint32_t index) const noexcept { return ids_[index]; }

  // Looks up the authority, and with `may_add` looks up the names again and forgets the ids that an
  // earlier attempt has assigned. Returns false if a name or the authority is new and may not be
  // added. `may_add` requires the topology mutex. Throws Rejected and bad_alloc.
  bool resolve(bool may_add) {
    if (!may_add)
      return find_authority(false) && std::find(ids_.begin(), ids_.end(), FrameId{0}) == ids_.end();
    new_.reset();
    find();
    // Before any id is assigned: a removed name of this commit may lose its own.
    if (most_created() > tree_.names.left()) free_removed_names(tree_);
    (void)find_authority(true);
    ids_freed_ = tree_.ids_freed.load(std::memory_order_acquire);
    return true;
  }

  // Returns the id of a name of the request; for a new name, the id that it will have. Requires the
  // topology mutex, and resolve(true). Throws Rejected at the limit of frames.
  FrameId id_or_new(std::uint32_t index) {
    if (ids_[index] == 0) ids_[index] = assign_id(names_[index]);
    return ids_[index];
  }

  // True if the limit of frames allows that id_or_new() creates those of these names that are new.
  // Requires the topology mutex, and resolve(true).
  [[nodiscard]] bool has_room(std::uint32_t one, std::uint32_t other) const {
    const auto is_new = [&](std::uint32_t index) {
      return ids_[index] == 0 && !(new_ && new_->ids.contains(names_[index]));
    };
    const std::size_t created = is_new(one) + (names_[one] != names_[other] && is_new(other));
    if (created == 0) return true;
    return tree_.names.live_names() + (new_ ? new_->ids.size() : 0) + created <=
           tree_.options.max_frames;
  }

  [[nodiscard]] AuthorityId authority() const noexcept { return authority_; }
  // False if the id of a name or of the authority may have passed to another one since it was
  // found. Requires the write locks of the frames that get samples; while they are held, no id
  // that the commit may store passes on (the invariant above, commits/freed_names.cpp).
  [[nodiscard]] bool are_ids_current() const noexcept {
    return tree_.ids_freed.load(std::memory_order_acquire) == ids_freed_;
  }
  // True if id_or_new() has assigned an id to a new name.
  [[nodiscard]] bool any_new() const noexcept { return new_.has_value(); }
  template <class Visit>
  void for_each_new(Visit&& visit) const {
    if (!new_) return;
    for (const auto& [name, id] : new_->ids) visit(name, id);
  }

  // Reserves memory so that publish() cannot fail. Throws bad_alloc.
  void reserve() {
    if (new_authority_) tree_.authorities.reserve(1, request_.authority.size());
    if (!new_) return;
    std::size_t bytes = 0;
    for (const auto& [id, name] : new_->created) bytes += name.size();
    tree_.names.reserve(new_->created.size(), bytes);
  }

  // Publishes the new names one by one; they are no part of a reader's snapshot. Requires
  // reserve(), and the topology mutex if a name is new.
  //
  // Version 0 means that a frame does not exist. `children`, ascending, are locked and get a new
  // version when they are unlocked. A frame that is only a parent gets its first version here. One
  // that comes back, or has the id of another, keeps its version: its record does not change, and
  // the version is not 0 (commits/freed_names.cpp).
  void publish(const FrameList& children) const noexcept {
    if (new_authority_)
      tree_.authority_counters.start(tree_.authorities.insert(request_.authority));
    if (!new_) return;
    for (const FrameId id : new_->returning) tree_.names.restore(id);
    for (const auto& [id, name] : new_->created) {
      SeqLock& version = tree_.frames[id].version;
      // If the id is used for the first time, no other thread knows it, so a store suffices.
      if (!std::binary_search(children.begin(), children.end(), id) && version.current() == 0)
        version.unlock_changed(next_version(0));
      [[maybe_unused]] const FrameId inserted = tree_.names.insert(name);
      assert(inserted == id);
    }
  }

 private:
  struct NewNames {
    NewNames() {}  // a constructor of its own: clang needs one for optional::emplace()

    std::map<std::string_view, FrameId> ids;                    // the ids that they will have
    std::vector<FrameId> returning;                             // of those that have one already
    std::vector<std::pair<FrameId, std::string_view>> created;  // the others, as they get theirs
  };

  bool find_authority(bool may_add) {
    const NameTable& authorities = tree_.authorities;
    new_authority_ = false;
    authority_ = 0;
    if (request_.authority.empty() || request_.rows.empty()) return true;
    authority_ = authorities.find(request_.authority);
    if (authority_ != 0) return true;
    if (!may_add) return false;
    if (authorities.left() == 0) free_authorities(tree_);
    if (authorities.left() == 0) reject_authority(request_.authority, authorities.max_size());
    authority_ = authorities.next_id();
    new_authority_ = true;
    return true;
  }

  // Returns how many ids the commit needs at most. Requires the topology mutex.
  [[nodiscard]] std::size_t most_created() const noexcept {
    std::size_t most = 0;
    for (std::size_t i = 0; i < ids_.size(); ++i)
      if (ids_[i] == 0 && tree_.names.find_any(names_[i]) == 0) ++most;
    return most;
  }

  void find() {
    if (!request_.frames.empty()) [[unlikely]]
      return find_frames();
    tree_.names.find_each({names_.begin(), names_.size()}, ids_.begin());
  }
  // Throws Rejected if one was removed. Not inlined: most commits come with names.
  [[gnu::noinline]] void find_frames() {
    FrameId* id = ids_.begin();
    for (const NameRef& frame : request_.frames) {
      if (!tree_.names.is_current(frame) || tree_.names.removed(frame.id)) reject_stale();
      *id++ = frame.id;
    }
  }

  // Returns the id that a new name will have. Throws Rejected at the limit of frames.
  FrameId assign_id(std::string_view name) {
    if (!new_) new_.emplace();
    const auto [it, is_first] = new_->ids.try_emplace(name, tree_.names.find_any(name));
    FrameId& id = it->second;
    if (!is_first) return id;
    if (tree_.names.live_names() + new_->ids.size() > tree_.options.max_frames)
      throw frame_rejection(name, tree_.options.max_frames);
    if (id != 0) {  // a removed frame's
      new_->returning.push_back(id);
      return id;
    }
    // There is one: all ids that frames do not need are free now, or as many as the commit needs.
    assert(new_->created.size() < tree_.names.left());
    id = tree_.names.next_id(new_->created.size());
    tree_.region.allocate_records(id);
    new_->created.emplace_back(id, name);
    return id;
  }

  TreeState& tree_;
  const CommitRequest& request_;
  AuthorityId authority_ = 0;
  bool new_authority_ = false;
  std::uint64_t ids_freed_ = 0;  // from before the ids were found
  bool all_valid_ = true;
  SmallVector<std::string_view, 32> names_;  // of the request, without a leading slash
  SmallVector<FrameId, 32> ids_;             // of names_; 0: new
  std::optional<NewNames> new_;
};

}  // namespace ztf
