// Entries of the change log as columns, as they are sent and replayed.
//
// Thread safety: none; lives on the consumer's stack.
#pragma once

#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "replication/change_replay.hpp"

namespace ztf {

class ChangeBatch {
 public:
  // The batch refers to the entries' texts. Throws bad_alloc.
  explicit ChangeBatch(const std::vector<LogEntryPtr>& entries) {
    for (const LogEntryPtr& entry : entries) add(*entry);
  }

  // By name and authority, each once.
  [[nodiscard]] const std::vector<std::string_view>& names() const noexcept { return names_.texts; }
  [[nodiscard]] const std::vector<std::string_view>& authorities() const noexcept {
    return authorities_.texts;
  }
  // `last`: the number of the last entry. The result refers to the batch.
  [[nodiscard]] ChangeColumns columns(Seq last) const noexcept {
    return {names(),   authorities(), kind, frame, version, parent,
            authority, stamp,         pose, lost,  last};
  }

  // By change.
  std::vector<ChangeKind> kind;
  std::vector<std::uint32_t> frame;
  std::vector<Version> version;
  // By sample or static link.
  std::vector<std::uint32_t> parent, authority;
  std::vector<Stamp> stamp;
  std::vector<Pose> pose;
  // By orphaned frame and lost parent.
  std::vector<std::uint32_t> lost;

 private:
  struct TextIndex {
    std::uint32_t add(std::string_view text) {
      const auto [at, is_new] = known.try_emplace(text, static_cast<std::uint32_t>(texts.size()));
      if (is_new) texts.push_back(text);
      return at->second;
    }
    std::unordered_map<std::string_view, std::uint32_t> known;
    std::vector<std::string_view> texts;
  };

  void add(const LogEntry& entry) {
    constexpr std::uint32_t kNone = ~std::uint32_t{0};
    std::vector<std::uint32_t> index(entry.names(), kNone);  // an entry repeats few names
    const auto name = [&](std::uint32_t i) {
      if (index[i] == kNone) index[i] = names_.add(entry.name(i));
      return index[i];
    };
    for (const Change& change : entry) {
      kind.push_back(change.kind);
      frame.push_back(name(change.frame));
      version.push_back(change.version);
      if (change.kind == ChangeKind::orphaned)
        lost.push_back(change.parent == kNoParent ? kNoParent : name(change.parent));
      if (!has_sample(change.kind)) continue;
      parent.push_back(name(change.parent));
      authority.push_back(authorities_.add(entry.authority()));
      stamp.push_back(change.stamp);
      pose.push_back(change.pose);
    }
  }

  TextIndex names_, authorities_;
};

}  // namespace ztf
