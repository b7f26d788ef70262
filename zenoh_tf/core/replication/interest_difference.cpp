// How the difference between a frame and what was sent of it is found.
#include "replication/interest_difference.hpp"

#include <algorithm>
#include <unordered_set>
#include <utility>

namespace ztf {

namespace {

// Added to a frame's version it is above all that the frame will ever have.
constexpr Version kVersionBound = Version{1} << 40;

}  // namespace

std::optional<InterestCopy> InterestDifference::copy(FrameId id, bool with_all) const {
  const auto at = sent_.find(id);
  const Sent* const sent =
      at != sent_.end() && tree_.names.is_current(at->second.ref) ? &at->second : nullptr;
  if (sent && !with_all && sent->version == tree_.version(id)) return std::nullopt;
  std::optional<InterestCopy> found(std::in_place);
  InterestCopy& copy = *found;
  copy.id = id;
  copy.is_new = !sent;
  if (copy.is_new) {
    copy.name = tree_.name(id);
    copy.ref = tree_.names.find_ref(copy.name);
  }
  // Returns the first sample to copy.
  const auto first = [&](std::uint32_t count, auto&& stamp_at) noexcept {
    copy.is_append = sent && copy.edits == sent->edits;
    std::uint32_t unsent = copy.is_append ? count : 0;  // the first that was not sent
    // A static link has not changed, else it would be no append.
    while (copy.is_append && !copy.is_static && unsent > 0 && stamp_at(unsent - 1) > sent->newest)
      --unsent;
    const std::uint32_t oldest = newest_only_ && count > 0 ? count - 1 : 0;
    unsent = std::max(unsent, oldest);
    const std::uint32_t from = with_all ? oldest : unsent;
    copy.first_new = unsent - from;
    return from;
  };
  copy.read(tree_.frames[id], tree_.edits[id], first);
  return found;
}

bool InterestDifference::has_changed() const {
  // A frame that is removed gets another version, too.
  return std::any_of(sent_.begin(), sent_.end(), [this](const auto& sent) {
    return tree_.version(sent.first) != sent.second.version;
  });
}

ChangeTable InterestDifference::changes(const std::vector<FrameId>& frames,
                                        const std::vector<InterestCopy>& copies,
                                        bool ever_reparented) {
  ChangeTable table;
  removed_.clear();
  const std::unordered_set<FrameId> present(frames.begin(), frames.end());
  for (const auto& [id, sent] : sent_)
    if (!present.contains(id) || !tree_.names.is_current(sent.ref)) {
      removed_.push_back(id);
      // The frame may come back with the version that it has now.
      table.add(ChangeKind::removed, table.names.add_copy(sent.name), sent.version + kVersionBound);
    }
  // Beside changes of theirs, because the first reparenting gives all frames a new version.
  if (ever_reparented && !sent_reparented_ && !copies.empty())
    table.add(ChangeKind::new_version, name(table, copies.front().id), copies.front().version);
  for (const InterestCopy& copy : copies) {
    const auto at = sent_.find(copy.id);
    if (!copy.is_new && at->second.version == copy.version) continue;
    if (!copy.is_new && !copy.is_append) {
      // Newest samples alone are kept if they may still belong to the history.
      const Stamp before = at->second.newest;
      const bool may_belong = newest_only_ && !copy.is_static && !copy.samples().empty() &&
                              copy.oldest <= before && copy.samples().back().stamp >= before;
      if (!may_belong) table.add(ChangeKind::cleared, name(table, copy.id), copy.version);
    }
    add(copy, copy.first_new, table);
  }
  return table;
}

ChangeTable InterestDifference::all(const std::vector<InterestCopy>& copies) const {
  ChangeTable table;
  for (const InterestCopy& copy : copies) add(copy, 0, table);
  return table;
}

std::uint32_t InterestDifference::name(ChangeTable& table, FrameId id) const {
  return table.names.add(id, [this](FrameId named) { return tree_.name(named); });
}

// Adds the samples from an index on.
void InterestDifference::add(const InterestCopy& copy, std::size_t first,
                             ChangeTable& table) const {
  const auto authority_of = [this](AuthorityId id) { return tree_.authority(id); };
  const std::uint32_t frame = name(table, copy.id);
  const auto samples = copy.samples().subspan(first);
  if (samples.empty()) table.add(ChangeKind::created, frame, copy.version);
  for (const auto& [stamp, parent, pose] : samples) {
    table.add(copy.is_static ? ChangeKind::static_link : ChangeKind::sample, frame, copy.version);
    table.add_sample(parent == 0 ? kNoParent : name(table, parent),
                     table.authorities.add(copy.authority, authority_of), stamp, pose);
  }
}

void InterestDifference::keep(std::vector<InterestCopy>& copies, bool ever_reparented) {
  for (const FrameId id : removed_) sent_.erase(id);
  for (InterestCopy& copy : copies) {
    Sent& sent = sent_[copy.id];
    if (copy.is_new) {
      sent.name = std::move(copy.name);
      sent.ref = copy.ref;
    }
    sent.version = copy.version;
    sent.edits = copy.edits;
    if (!copy.samples().empty()) sent.newest = copy.samples().back().stamp;
  }
  sent_reparented_ |= ever_reparented && !copies.empty();
}

}  // namespace ztf
