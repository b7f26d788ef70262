// ChangeReplay: snapshots and changes of another tree are replayed into this one.
//
// GIL: replaying releases it.
#include "replication/change_replay.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_set>

#include "bindings/replication/message_columns.hpp"
#include "commits/validation.hpp"
#include "replication/snapshot.hpp"

namespace ztf {

namespace {

// A version that is not one would leave a frame locked, or without a name.
void check_versions(std::span<const Version> column) {
  constexpr Version kBits = SeqLock::kWriting | SeqLock::kWriteLocked;
  for (const Version version : column)
    if (version == 0 || (version & kBits) != 0)
      raise_invalid("version has " + std::to_string(version) + ", which no frame can have",
                    "version");
}

// A pose that no commit accepts would make results infinite, or no number.
void check_poses(std::span<const Pose> column) {
  for (const Pose& p : column) {
    const double norm2 = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw;
    if (!is_valid_translation(p) || !(std::abs(norm2 - 1) < 1e-2))
      raise_invalid("pose has a value that no link can have", "pose");
  }
}

// Names and authorities as texts that live as long as this object.
struct Texts {
  Texts(const Tree& tree, nb::handle name_list, nb::handle authority_list)
      : name_objects(names_of(tree.options(), name_list, names, "names")),
        authority_objects(names_of(tree.options(), authority_list, authorities, "authorities")) {
    // A frame under two indexes would be locked twice, by a thread that waits for itself.
    std::unordered_set<std::string_view> known(names.size());
    for (const std::string_view name : names) {
      if (name.empty()) raise_invalid("names has an empty name", "names");
      if (name[0] == '/')
        raise_invalid("names has " + quoted(name) + ", but no frame's name begins with '/'",
                      "names");
      if (has_zero(name)) raise_invalid("names has a name with a zero character", "names");
      if (!known.insert(name).second) raise_invalid("names has a name twice", "names");
    }
  }

  std::vector<std::string_view> names, authorities;
  nb::tuple name_objects, authority_objects;
};

class Replay {
 public:
  explicit Replay(Tree& tree) : tree_(tree), replay_(tree.state()) {
    if (tree.options().concurrency == Concurrency::giant)
      raise_invalid(
          "a tree of concurrency 'giant' cannot be a mirror: a replay does not take its "
          "mutex",
          "concurrency");
  }

  void apply(Seq last, const Changes& changes) {
    const Texts texts(tree_, changes.names, changes.authorities);
    const ChangeColumns columns = changes.view(texts.names, texts.authorities);
    check_versions(columns.version);
    check_poses(columns.pose);
    rejected_as_error([&] {
      const GilReleased released;
      replay_.apply(columns, last);
    });
  }

  void load(const Frames& frames) {
    const Texts texts(tree_, frames.names, frames.authorities);
    const FrameColumns columns = frames.view(texts.names, texts.authorities);
    check_versions(columns.version);
    check_poses(columns.pose);
    std::size_t samples = 0;
    for (std::size_t i = 0; i < columns.frame.size(); ++i) {
      const std::uint32_t count = columns.count[i];
      if (columns.is_static[i] && count != 1)
        raise_invalid("a static frame has one sample", "count");
      check_stamps(columns.stamp.subspan(samples, count));
      samples += count;
    }
    rejected_as_error([&] {
      const GilReleased released;
      replay_.load(columns);
    });
  }

  void set_ever_reparented() { replay_.set_ever_reparented(); }

 private:
  // A frame's samples must have ascending stamps.
  static void check_stamps(std::span<const Stamp> stamps) {
    for (std::size_t i = 1; i < stamps.size(); ++i)
      if (stamps[i] <= stamps[i - 1]) raise_invalid("stamp must ascend in each frame", "stamp");
  }

  Tree& tree_;
  ChangeReplay replay_;
};

}  // namespace

void bind_change_replay(nb::module_& m) {
  nb::class_<Replay>(m, "ChangeReplay", "Makes a tree the mirror of another.")
      .def(nb::init<Tree&>(), nb::arg("tree"), nb::keep_alive<1, 2>())
      .def("apply", &Replay::apply, nb::arg("last"), nb::arg("changes"))
      .def("load", &Replay::load, nb::arg("frames"))
      .def("set_ever_reparented", &Replay::set_ever_reparented);
}

}  // namespace ztf
