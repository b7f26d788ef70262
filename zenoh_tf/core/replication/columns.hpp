// Changes and frames as columns: as they are collected, sent and replayed.
//
// A change names its frame, version and authority. A piece of a snapshot names them once for all
// samples of a frame, which takes a fifth off its size.
//
// Thread safety: none.
#pragma once

#include <deque>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "records/change_log.hpp"

namespace ztf {

// The texts that a column's indices refer to, each once, in the order of their first use.
class TextColumn {
 public:
  TextColumn() = default;
  TextColumn(TextColumn&&) = default;
  TextColumn& operator=(TextColumn&&) = default;

  // Returns the text's index. The text must outlive the column. Throws bad_alloc.
  std::uint32_t add(std::string_view text) {
    const auto [at, is_new] = known_.try_emplace(text, static_cast<std::uint32_t>(texts_.size()));
    if (is_new) texts_.push_back(text);
    return at->second;
  }
  // Returns the index of the text of an id. Calls text_of(id) once for each id, and keeps a copy.
  template <class TextOf>
  std::uint32_t add(std::uint32_t id, TextOf&& text_of) {
    if (const auto at = ids_.find(id); at != ids_.end()) return at->second;
    return ids_[id] = add_copy(text_of(id));
  }
  // As add(), of a text that need not outlive the column.
  std::uint32_t add_copy(std::string text) {
    const auto at = known_.find(text);
    return at != known_.end() ? at->second : add(kept_.emplace_back(std::move(text)));
  }
  // NOLINTNEXTLINE(google-explicit-constructor)
  operator std::span<const std::string_view>() const noexcept { return texts_; }

 private:
  std::vector<std::string_view> texts_;
  std::unordered_map<std::string_view, std::uint32_t> known_;
  std::unordered_map<std::uint32_t, std::uint32_t> ids_;
  std::deque<std::string> kept_;
};

template <class T>
using ColumnView = std::span<const T>;

// Frames and parents are indices into `names`. No parent (kNoParent): its id was
// freed.
template <template <class> class Column, class Texts>
struct BasicChangeColumns {
  Texts names, authorities;
  // By change.
  Column<ChangeKind> kind;
  Column<std::uint32_t> frame;
  Column<Version> version;
  // By sample or static link, in the order of the changes.
  Column<std::uint32_t> parent, authority;
  Column<Stamp> stamp;
  Column<Pose> pose;
  // By change of the kind `orphaned`: the parent that samples lost, or kNoParent.
  Column<std::uint32_t> lost;

  // Calls visit(name, column) for each column, in the order of a message.
  template <class Visit>
  static void each_column(Visit&& visit) {
    visit("kind", &BasicChangeColumns::kind);
    visit("frame", &BasicChangeColumns::frame);
    visit("version", &BasicChangeColumns::version);
    visit("parent", &BasicChangeColumns::parent);
    visit("authority", &BasicChangeColumns::authority);
    visit("stamp", &BasicChangeColumns::stamp);
    visit("pose", &BasicChangeColumns::pose);
    visit("lost", &BasicChangeColumns::lost);
  }
};
using ChangeColumns = BasicChangeColumns<ColumnView, ColumnView<std::string_view>>;

// Some frames of a snapshot. Frames and parents are indices into `names`.
template <template <class> class Column, class Texts>
struct BasicFrameColumns {
  Texts names, authorities;
  // By frame. A frame with a static link has one sample.
  Column<std::uint32_t> frame;
  Column<Version> version;
  Column<std::uint8_t> is_static;
  Column<std::uint32_t> authority, count;
  // By sample, of all frames in turn. No parent (kNoParent): its id was
  // freed.
  Column<Stamp> stamp;
  Column<std::uint32_t> parent;
  Column<Pose> pose;

  template <class Visit>
  static void each_column(Visit&& visit) {
    visit("frame", &BasicFrameColumns::frame);
    visit("version", &BasicFrameColumns::version);
    visit("static", &BasicFrameColumns::is_static);
    visit("authority", &BasicFrameColumns::authority);
    visit("count", &BasicFrameColumns::count);
    visit("stamp", &BasicFrameColumns::stamp);
    visit("parent", &BasicFrameColumns::parent);
    visit("pose", &BasicFrameColumns::pose);
  }
};
using FrameColumns = BasicFrameColumns<ColumnView, ColumnView<std::string_view>>;

template <class T>
using OwnColumn = std::vector<T>;

// Columns that own their values.
struct ChangeTable : BasicChangeColumns<OwnColumn, TextColumn> {
  void add(ChangeKind k, std::uint32_t f, Version v) {
    kind.push_back(k);
    frame.push_back(f);
    version.push_back(v);
  }
  // The sample of the last change.
  void add_sample(std::uint32_t p, std::uint32_t a, Stamp s, const Pose& x) {
    parent.push_back(p);
    authority.push_back(a);
    stamp.push_back(s);
    pose.push_back(x);
  }
  [[nodiscard]] ChangeColumns view() const noexcept {
    return {names, authorities, kind, frame, version, parent, authority, stamp, pose, lost};
  }
};

struct FrameTable : BasicFrameColumns<OwnColumn, TextColumn> {
  [[nodiscard]] FrameColumns view() const noexcept {
    return {names, authorities, frame, version, is_static, authority, count, stamp, parent, pose};
  }
};

// The entries' changes. The table refers to the entries' texts. Throws bad_alloc.
ChangeTable changes_of(std::span<const LogEntryPtr> entries);

}  // namespace ztf
