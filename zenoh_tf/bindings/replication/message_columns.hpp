// Changes and Frames: the columns of a message of the stream, and of a snapshot's piece.
//
// Each column is its bytes, little-endian, as messages have them: so a message is made and read
// without a copy of its numbers. They were checked when the object was made, and never change.
#pragma once

#include "bindings/bindings.hpp"
#include "replication/columns.hpp"

namespace ztf {

class Changes {
 public:
  explicit Changes(const ChangeTable& table);
  // Raises ProtocolError if the fields of a message are no changes.
  explicit Changes(const nb::dict& message);

  // As a message has them; `lost` only if there are any.
  [[nodiscard]] nb::dict fields() const;
  // The columns; names and authorities are those of the caller, who has their texts.
  [[nodiscard]] ChangeColumns view(std::span<const std::string_view> name_texts,
                                   std::span<const std::string_view> authority_texts) const;

  // Calls visit(name, column, its column in a table) for each.
  template <class Visit>
  static void each_column(Visit&& visit) {
    visit("kind", &Changes::kind, &ChangeTable::kind);
    visit("frame", &Changes::frame, &ChangeTable::frame);
    visit("version", &Changes::version, &ChangeTable::version);
    visit("parent", &Changes::parent, &ChangeTable::parent);
    visit("authority", &Changes::authority, &ChangeTable::authority);
    visit("stamp", &Changes::stamp, &ChangeTable::stamp);
    visit("pose", &Changes::pose, &ChangeTable::pose);
    visit("lost", &Changes::lost, &ChangeTable::lost);
  }

  nb::tuple names, authorities;
  nb::bytes kind, frame, version, parent, authority, stamp, pose, lost;
};

class Frames {
 public:
  explicit Frames(const FrameTable& table);
  explicit Frames(const nb::dict& message);

  [[nodiscard]] nb::dict fields() const;
  [[nodiscard]] FrameColumns view(std::span<const std::string_view> name_texts,
                                  std::span<const std::string_view> authority_texts) const;

  template <class Visit>
  static void each_column(Visit&& visit) {
    visit("frame", &Frames::frame, &FrameTable::frame);
    visit("version", &Frames::version, &FrameTable::version);
    visit("static", &Frames::is_static, &FrameTable::is_static);
    visit("authority", &Frames::authority, &FrameTable::authority);
    visit("count", &Frames::count, &FrameTable::count);
    visit("stamp", &Frames::stamp, &FrameTable::stamp);
    visit("parent", &Frames::parent, &FrameTable::parent);
    visit("pose", &Frames::pose, &FrameTable::pose);
  }

  nb::tuple names, authorities;
  nb::bytes frame, version, is_static, authority, count, stamp, parent, pose;
};

}  // namespace ztf
