// The names of a commit as frame ids.
//
// A name is new if no frame has it now: it never existed, or its frame was removed. A removed name
// comes back with its old id; the others get the next ids, in the order of the commit's rows.
//
// Thread safety: lives on the writer's stack. Assigning ids and publishing names require the
// topology mutex: it keeps a new name new, and the next id free.
// Invariant: ids that were found without the mutex may be stale, which is safe. A removed child has
// no parent, and a removed parent has no children. So the row stores another parent than the child
// has: CommitPlan::decide() asks for the topology mutex, and the names are looked up again.
#pragma once

#include <algorithm>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "commit_validation.hpp"

namespace ztf {

class CommitNames {
 public:
  CommitNames(Tree& tree, const CommitRequest& request) : tree_(tree), request_(request) {
    std::string_view* name = names_.append(request.names.size());
    for (const std::string_view as_given : request.names) {
      *name = stripped(as_given);
      all_valid_ &= is_valid_name(*name++, tree.options_);
    }
    (void)ids_.append(request.names.size());
    find();
  }

  // True if no name is empty or too long.
  [[nodiscard]] bool all_valid() const noexcept { return all_valid_; }
  // The id of a name of the request; 0 if the name is new.
  [[nodiscard]] FrameId id(std::uint32_t index) const noexcept { return ids_[index]; }
  // The name itself, as it is stored.
  [[nodiscard]] std::string_view name(std::uint32_t index) const noexcept { return names_[index]; }

  // Looks up the authority, and with `may_add` looks up the names again and forgets the ids that an
  // earlier attempt has assigned. Returns false if a name or the authority is new and may not be
  // added. `may_add` requires the topology mutex. Throws Rejected.
  bool resolve(bool may_add) {
    if (may_add) {
      new_.reset();
      find();
    }
    return find_authority(may_add) &&
           (may_add || std::find(ids_.begin(), ids_.end(), FrameId{0}) == ids_.end());
  }

  // Returns the id of a name of the request; for a new name, the id that it will have. Requires the
  // topology mutex, and resolve(true). Throws Rejected at the limit of frames.
  FrameId id_or_new(std::uint32_t index) {
    if (ids_[index] == 0) ids_[index] = assign_id(names_[index]);
    return ids_[index];
  }

  [[nodiscard]] AuthorityId authority() const noexcept { return authority_; }
  // False if the authority's id may have passed to another one since resolve(). The answer holds
  // for as long as the caller holds the write lock of any frame.
  [[nodiscard]] bool is_authority_current() const noexcept {
    return tree_.authorities_forgotten_.load(std::memory_order_acquire) == authorities_forgotten_;
  }
  // True if id_or_new() has assigned an id to a new name.
  [[nodiscard]] bool any_new() const noexcept { return new_.has_value(); }
  [[nodiscard]] std::uint64_t frame_count_after() const noexcept {
    return std::uint64_t{tree_.names_.size()} + (new_ ? new_->created : 0);
  }
  template <class Visit>
  void for_each_new(Visit&& visit) const {
    if (!new_) return;
    for (const auto& [name, id] : new_->ids) visit(name, id);
  }

  // Reserves memory so that publish() cannot fail. Throws bad_alloc.
  void reserve() {
    if (new_authority_) tree_.authorities_.reserve(1, request_.authority.size());
    if (!new_) return;
    std::size_t bytes = 0;
    for (const auto& [name, id] : new_->ids) {
      new_->in_order.emplace_back(id, name);
      bytes += name.size();
    }
    std::sort(new_->in_order.begin(), new_->in_order.end());
    tree_.names_.reserve(new_->in_order.size(), bytes);
  }

  // Publishes the new names one by one; they are no part of a reader's snapshot. Requires
  // reserve(), and the topology mutex if a name is new.
  //
  // Version 0 means that a frame does not exist. `children`, ascending, are locked and get a new
  // version when they are unlocked. A frame that is only a parent gets its first version here. One
  // that comes back keeps its version: its record does not change, and the version is not 0.
  void publish(const FrameList& children) const noexcept {
    if (new_authority_)
      tree_.authority_counters_.start(tree_.authorities_.insert(request_.authority));
    if (!new_) return;
    for (const auto& [id, name] : new_->in_order) {
      if (id <= tree_.names_.size()) {
        tree_.names_.show(id);
        continue;
      }
      // Nobody holds this lock. No other thread uses a frame without a name, so a store suffices.
      if (!std::binary_search(children.begin(), children.end(), id))
        tree_.frames_[id].version.unlock_changed(0);
      tree_.names_.insert(name);
    }
  }

 private:
  struct NewNames {
    NewNames() {}  // a constructor of its own: clang needs one for optional::emplace()

    std::map<std::string_view, FrameId> ids;                     // the ids that they will have
    std::uint32_t created = 0;                                   // how many of them never existed
    std::vector<std::pair<FrameId, std::string_view>> in_order;  // by id
  };

  bool find_authority(bool may_add) {
    const NameTable& authorities = tree_.authorities_;
    authorities_forgotten_ = tree_.authorities_forgotten_.load(std::memory_order_acquire);
    new_authority_ = false;
    authority_ = 0;
    if (request_.authority.empty() || request_.rows.empty()) return true;
    authority_ = authorities.find(request_.authority);
    if (authority_ != 0) return true;
    if (!may_add) return false;
    if (authorities.left() == 0) tree_.forget_authorities();
    if (authorities.left() == 0) reject_authority(request_.authority, authorities.max_size());
    authorities_forgotten_ = tree_.authorities_forgotten_.load(std::memory_order_acquire);
    authority_ = authorities.next_id();
    new_authority_ = true;
    return true;
  }

  void find() noexcept { tree_.names_.find_each({names_.begin(), names_.size()}, ids_.begin()); }

  // Returns the id that a new name will have. Throws Rejected at the limit of frames.
  FrameId assign_id(std::string_view name) {
    if (!new_) new_.emplace();
    const auto [it, is_first] = new_->ids.try_emplace(name, tree_.names_.find_any(name));
    FrameId& id = it->second;
    if (!is_first || id != 0) return id;  // an earlier row's name, or a removed frame's
    if (frame_count_after() >= tree_.options_.max_frames)
      reject_frame(name, tree_.options_.max_frames);
    ++new_->created;
    return id = static_cast<FrameId>(frame_count_after());
  }

  Tree& tree_;
  const CommitRequest& request_;
  AuthorityId authority_ = 0;
  bool new_authority_ = false;
  std::uint64_t authorities_forgotten_ = 0;  // as of resolve()
  bool all_valid_ = true;
  SmallVector<std::string_view, 32> names_;  // of the request, without a leading slash
  SmallVector<FrameId, 32> ids_;             // of names_; 0: new
  std::optional<NewNames> new_;
};

}  // namespace ztf
