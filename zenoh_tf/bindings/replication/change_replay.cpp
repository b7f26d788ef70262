// ChangeReplay: snapshots and changes of another tree are replayed into this one.
//
// GIL: replaying releases it.
#include "replication/change_replay.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_set>

#include "bindings/reads/read_rows.hpp"
#include "commits/validation.hpp"
#include "replication/snapshot.hpp"

namespace ztf {

namespace {

// `none`: an index that refers to nothing.
void check_indexes(const Column<std::uint32_t>& column, std::size_t size, const char* field,
                   std::optional<std::uint32_t> none = {}) {
  rejected_as_error([&] {
    for (const std::uint32_t index : span_of(column))
      if (index != none) checked(index, size, field);
  });
}

// A version that is not one would leave a frame locked, or without a name.
void check_versions(const Column<Version>& column) {
  constexpr Version kBits = SeqLock::kWriting | SeqLock::kWriteLocked;
  for (const Version version : span_of(column))
    if (version == 0 || (version & kBits) != 0)
      raise_invalid("version has " + std::to_string(version) + ", which no frame can have",
                    "version");
}

// A pose that no commit accepts would make results infinite, or no number.
void check_poses(const PoseColumn& column) {
  for (const Pose& p : span_of(column)) {
    const double norm2 = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw;
    if (!is_valid_translation(p) || !(std::abs(norm2 - 1) < 1e-2))
      raise_invalid("pose has a value that no link can have", "pose");
  }
}

// Names and authorities as texts that live as long as this object.
struct Texts {
  Texts(const Tree& tree, nb::handle name_list, nb::handle authority_list)
      : name_objects(names_of(tree, name_list, names, "names")),
        authority_objects(names_of(tree, authority_list, authorities, "authorities")) {
    // A frame under two indexes would be locked twice, by a thread that waits for itself.
    std::unordered_set<std::string_view> known(names.size());
    for (const std::string_view name : names) {
      if (name.empty()) raise_invalid("names has an empty name", "names");
      if (name[0] == '/')
        raise_invalid("names has " + quoted(name) + ", but no frame's name begins with '/'",
                      "names");
      if (!known.insert(name).second) raise_invalid("names has a name twice", "names");
    }
  }

  std::vector<std::string_view> names, authorities;
  std::vector<nb::object> name_objects, authority_objects;
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

  void apply(Seq last, nb::handle names, nb::handle authorities, const Column<std::uint8_t>& kind,
             const Column<std::uint32_t>& frame, const Column<Version>& version,
             const Column<std::uint32_t>& parent, const Column<std::uint32_t>& authority,
             const Column<Stamp>& stamp, const PoseColumn& pose,
             const Column<std::uint32_t>& lost) {
    const Texts texts(tree_, names, authorities);
    fit(frame, kind.shape(0), "frame");
    fit(version, kind.shape(0), "version");
    check_indexes(frame, texts.names.size(), "frame");
    check_versions(version);
    std::vector<ChangeKind> kinds(kind.shape(0));
    std::size_t samples = 0, orphaned = 0;
    for (std::size_t i = 0; i < kinds.size(); ++i) {
      if (kind(i) > static_cast<std::uint8_t>(ChangeKind::orphaned))
        raise_invalid("kind has the unknown kind " + std::to_string(kind(i)), "kind");
      kinds[i] = static_cast<ChangeKind>(kind(i));
      samples += has_sample(kinds[i]);
      orphaned += kinds[i] == ChangeKind::orphaned;
    }
    fit(parent, samples, "parent");
    fit(authority, samples, "authority");
    fit(stamp, samples, "stamp");
    fit(pose, samples, "pose");
    fit(lost, orphaned, "lost");
    check_poses(pose);
    check_indexes(parent, texts.names.size(), "parent", kNoParent);
    check_indexes(lost, texts.names.size(), "lost", kNoParent);
    check_indexes(authority, texts.authorities.size(), "authority");
    const ChangeColumns columns{
        texts.names,     texts.authorities,  kinds,          span_of(frame), span_of(version),
        span_of(parent), span_of(authority), span_of(stamp), span_of(pose),  span_of(lost)};
    rejected_as_error([&] {
      const GilReleased released;
      replay_.apply(columns, last);
    });
  }

  void load(nb::handle names, nb::handle authorities, const Column<std::uint32_t>& frame,
            const Column<Version>& version, const Column<std::uint8_t>& is_static,
            const Column<std::uint32_t>& authority, const Column<std::uint32_t>& count,
            const Column<Stamp>& stamp, const Column<std::uint32_t>& parent,
            const PoseColumn& pose) {
    const Texts texts(tree_, names, authorities);
    const std::size_t n = frame.shape(0);
    fit(version, n, "version");
    fit(is_static, n, "static");
    fit(authority, n, "authority");
    fit(count, n, "count");
    check_indexes(frame, texts.names.size(), "frame");
    check_indexes(authority, texts.authorities.size(), "authority");
    check_versions(version);
    std::size_t samples = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (is_static(i) && count(i) != 1) raise_invalid("a static frame has one sample", "count");
      check_stamps(stamp, samples, count(i));
      samples += count(i);
    }
    fit(stamp, samples, "stamp");
    fit(parent, samples, "parent");
    fit(pose, samples, "pose");
    check_poses(pose);
    const FrameColumns columns{
        texts.names,        texts.authorities, span_of(frame), span_of(version), span_of(is_static),
        span_of(authority), span_of(count),    span_of(stamp), span_of(parent),  span_of(pose)};
    rejected_as_error([&] {
      const GilReleased released;
      replay_.load(columns);
    });
  }

  void set_ever_reparented() { replay_.set_ever_reparented(); }

 private:
  // A frame's samples must have ascending stamps.
  static void check_stamps(const Column<Stamp>& stamp, std::size_t first, std::size_t count) {
    if (stamp.shape(0) - first < count) raise_invalid("stamp has too few rows", "stamp");
    for (std::size_t i = first + 1; i < first + count; ++i)
      if (stamp(i) <= stamp(i - 1)) raise_invalid("stamp must ascend in each frame", "stamp");
  }

  Tree& tree_;
  ChangeReplay replay_;
};

}  // namespace

void bind_change_replay(nb::module_& m) {
  nb::class_<Replay>(m, "ChangeReplay", "Makes a tree the mirror of another.")
      .def(nb::init<Tree&>(), nb::arg("tree"), nb::keep_alive<1, 2>())
      .def("apply", &Replay::apply, nb::arg("last"), nb::arg("names"), nb::arg("authorities"),
           nb::arg("kind"), nb::arg("frame"), nb::arg("version"), nb::arg("parent"),
           nb::arg("authority"), nb::arg("stamp"), nb::arg("pose"), nb::arg("lost"))
      .def("load", &Replay::load, nb::arg("names"), nb::arg("authorities"), nb::arg("frame"),
           nb::arg("version"), nb::arg("static"), nb::arg("authority"), nb::arg("count"),
           nb::arg("stamp"), nb::arg("parent"), nb::arg("pose"))
      .def("set_ever_reparented", &Replay::set_ever_reparented);
}

}  // namespace ztf
