// The names of a commit as frame ids: known names are found, new ones get numbers in the order of
// the commit's rows, and are published once nothing can fail any more.
//
// Thread safety: lives on the writer's stack. Numbering and publishing require the topology mutex:
// it keeps a new name new, and the next number free.
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

  // Looks up the names and the authority, and forgets what an earlier attempt has numbered. Returns
  // false where one is new and may not be added. `may_add` requires the topology mutex. Throws
  // Rejected.
  bool resolve(bool may_add) {
    if (may_add) {
      new_.reset();
      find();
    }
    return find_authority(may_add) &&
           (may_add || std::find(ids_.begin(), ids_.end(), FrameId{0}) == ids_.end());
  }

  // The id of a name of the request; for a new name, the id that it will have. Throws Rejected.
  FrameId id_or_new(std::uint32_t index) {
    if (ids_[index] == 0) ids_[index] = number(names_[index]);
    return ids_[index];
  }

  [[nodiscard]] AuthorityId authority() const noexcept { return authority_; }
  // True if a name is new, or was removed and comes back.
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

  // Shows the new names to others. `locked` are this commit's children, ascending: their versions
  // change when they are unlocked. A new frame that is only a parent gets its first version here,
  // as version 0 means that a frame does not exist. A frame that comes back has a version.
  void publish(const FrameList& locked) const noexcept {
    if (new_authority_) tree_.authorities_.insert(request_.authority);
    if (!new_) return;
    for (const auto& [id, name] : new_->in_order) {
      if (id <= tree_.names_.size()) {
        tree_.names_.show(id);
        continue;
      }
      if (!std::binary_search(locked.begin(), locked.end(), id))
        tree_.frames_[id].version.unlock_changed(0);
      tree_.names_.insert(name);
    }
  }

 private:
  struct NewNames {
    NewNames() {}  // a constructor of its own: clang needs one for optional::emplace()

    std::map<std::string_view, FrameId> ids;  // the ids that they will have
    std::uint32_t created = 0;  // names that never existed; the others were removed and come back
    std::vector<std::pair<FrameId, std::string_view>> in_order;  // by id
  };

  bool find_authority(bool may_add) {
    const NameTable& authorities = tree_.authorities_;
    new_authority_ = false;
    authority_ = 0;
    if (request_.authority.empty() || request_.rows.empty()) return true;
    authority_ = authorities.find(request_.authority);
    if (authority_ != 0) return true;
    if (!may_add) return false;
    if (authorities.size() == authorities.max_size())
      reject_authority(request_.authority, authorities.max_size());
    authority_ = authorities.size() + 1;
    new_authority_ = true;
    return true;
  }

  void find() noexcept { tree_.names_.find_each({names_.begin(), names_.size()}, ids_.begin()); }

  FrameId number(std::string_view name) {
    if (!new_) new_.emplace();
    const auto [it, is_first] = new_->ids.try_emplace(name, tree_.names_.find_any(name));
    FrameId& id = it->second;
    if (!is_first || id != 0) return id;  // numbered by an earlier row, or a removed frame's id
    if (frame_count_after() >= tree_.options_.max_frames)
      reject_frame(name, tree_.options_.max_frames);
    ++new_->created;
    return id = static_cast<FrameId>(frame_count_after());
  }

  Tree& tree_;
  const CommitRequest& request_;
  AuthorityId authority_ = 0;
  bool new_authority_ = false;
  bool all_valid_ = true;
  SmallVector<std::string_view, 32> names_;  // of the request, without a leading slash
  SmallVector<FrameId, 32> ids_;             // of names_; 0: new
  std::optional<NewNames> new_;
};

}  // namespace ztf
