// The names of a commit, as ids: those that exist are found, new ones are numbered in the order of
// their rows, and shown to others once nothing can fail any more.
//
// Thread safety: lives on the writer's stack. Numbers only while the topology mutex is held, which
// guards the names: it does not change that a name is new, nor which number is next.
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

  // Whether all are neither empty nor too long.
  [[nodiscard]] bool all_valid() const noexcept { return all_valid_; }
  // 0 where the name is new.
  [[nodiscard]] FrameId id(std::uint32_t index) const noexcept { return ids_[index]; }

  // Forgets what an earlier attempt has numbered. False where a name, or the authority, is new and
  // may not be numbered.
  bool start(bool may_assign_ids) {
    may_assign_ids_ = may_assign_ids;
    if (may_assign_ids) {
      new_.reset();
      find();
    }
    return find_authority() &&
           (may_assign_ids || std::ranges::find(ids_, FrameId{0}) == ids_.end());
  }

  // Its id, or that it will have.
  FrameId number(std::uint32_t index) {
    FrameId& id = ids_[index];
    return id != 0 ? id : id = number(names_[index]);
  }

  [[nodiscard]] AuthorityId authority() const noexcept { return authority_; }
  // New, or hidden until now.
  [[nodiscard]] bool any_new() const noexcept { return new_.has_value(); }
  [[nodiscard]] std::uint64_t frame_count_after() const noexcept {
    return std::uint64_t{tree_.names_.size()} + (new_ ? new_->frames : 0);
  }
  template <class Visit>
  void for_each_new(Visit&& visit) const {
    if (!new_) return;
    for (const auto& [name, id] : new_->ids) visit(name, id);
  }

  // After it publish() cannot fail.
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

  // A frame that exists has a version other than 0, be it but a parent; the written ones get theirs
  // where they are unlocked. One that comes back has it already.
  void publish(const FrameList& written) noexcept {
    if (new_authority_) tree_.authorities_.insert(request_.authority);
    if (!new_) return;
    for (const auto& [id, name] : new_->in_order) {
      if (id <= tree_.names_.size()) {
        tree_.names_.show(id);
        continue;
      }
      if (!std::binary_search(written.begin(), written.end(), id))
        tree_.frames_[id].version.unlock_changed(0);
      tree_.names_.insert(name);
    }
  }

 private:
  bool find_authority() {
    const NameTable& authorities = tree_.authorities_;
    new_authority_ = false;
    authority_ = 0;
    if (request_.authority.empty() || request_.rows.empty()) return true;
    authority_ = authorities.find(request_.authority);
    if (authority_ != 0) return true;
    if (!may_assign_ids_) return false;
    if (authorities.size() == authorities.max_size()) reject_authority(authorities.max_size());
    authority_ = authorities.size() + 1;
    new_authority_ = true;
    return true;
  }

  void find() noexcept {
    tree_.names_.find_each({names_.begin(), names_.size()}, ids_.begin(),
                           [&](FrameId id) { tree_.frames_[id].prefetch(); });
  }

  FrameId number(std::string_view name) {
    if (!new_) new_.emplace();
    const auto [it, is_first] = new_->ids.try_emplace(name, tree_.names_.find_any(name));
    FrameId& id = it->second;  // so far that of a hidden name
    if (!is_first || id != 0) return id;
    if (frame_count_after() >= tree_.options_.max_frames)
      reject_frame(name, tree_.options_.max_frames);
    ++new_->frames;
    return id = static_cast<FrameId>(frame_count_after());
  }

  struct New {
    New() {}  // Clang refuses an implicit one here: the enclosing class is not complete yet.
    std::map<std::string_view, FrameId> ids;  // that they will have
    std::uint32_t frames = 0;                 // how many were never there; the others are hidden
    std::vector<std::pair<FrameId, std::string_view>> in_order;
  };

  Tree& tree_;
  const CommitRequest& request_;
  bool may_assign_ids_ = false;
  AuthorityId authority_ = 0;
  bool new_authority_ = false;
  bool all_valid_ = true;
  SmallVector<std::string_view, 32> names_;  // of the request, stripped
  SmallVector<FrameId, 32> ids_;             // of names_; 0: new
  std::optional<New> new_;
};

}  // namespace ztf
