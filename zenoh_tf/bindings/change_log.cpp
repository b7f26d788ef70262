// ChangeLog: the consumer of a tree's change log, and the reader of its snapshots.
//
// GIL: waiting, and reading a snapshot, release it.
#include <algorithm>
#include <string>
#include <unordered_map>

#include "bindings.hpp"
#include "snapshot.hpp"

namespace ztf {

namespace {

template <class T>
nb::object array_of(const std::vector<T>& values) {
  return make_array<T>({values.size()}, [&](T* d) { std::copy(values.begin(), values.end(), d); });
}

nb::object poses_of(const std::vector<Pose>& poses) {
  return make_array<double>({poses.size(), 7}, [&](double* d) {
    for (const Pose& pose : poses) d = std::copy_n(&pose.x, 7, d);
  });
}

nb::list texts_of(const std::vector<std::string>& texts) {
  nb::list out;
  for (const std::string& text : texts) out.append(nb::str(text.data(), text.size()));
  return out;
}

// Texts, each once.
class TextIndex {
 public:
  std::uint32_t add(std::string_view text) {
    const auto [at, is_new] = known_.try_emplace(text, static_cast<std::uint32_t>(texts_.size()));
    if (is_new) texts_.emplace_back(text);
    return at->second;
  }
  [[nodiscard]] const std::vector<std::string>& texts() const noexcept { return texts_; }

 private:
  std::unordered_map<std::string_view, std::uint32_t> known_;  // of the entries' texts
  std::vector<std::string> texts_;
};

// Changes of several entries as columns (change_replay.hpp).
struct Columns {
  explicit Columns(const std::vector<LogEntryPtr>& entries) {
    for (const LogEntryPtr& entry : entries) add(*entry);
  }

  void add(const LogEntry& entry) {
    std::vector<std::uint32_t> index(entry.names(), kNone);
    const auto name = [&](std::uint32_t i) {
      if (index[i] == kNone) index[i] = names.add(entry.name(i));
      return index[i];
    };
    for (const Change& change : entry) {
      kind.push_back(static_cast<std::uint8_t>(change.kind));
      frame.push_back(name(change.frame));
      version.push_back(change.version);
      if (change.kind != ChangeKind::sample && change.kind != ChangeKind::static_link) continue;
      parent.push_back(name(change.parent));
      authority.push_back(authorities.add(entry.authority()));
      stamp.push_back(change.stamp);
      pose.push_back(change.pose);
    }
  }

  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  TextIndex names, authorities;
  std::vector<std::uint8_t> kind;
  std::vector<std::uint32_t> frame, parent, authority;
  std::vector<Version> version;
  std::vector<Stamp> stamp;
  std::vector<Pose> pose;
};

class Consumer {
 public:
  explicit Consumer(Tree& tree) : tree_(tree), log_(tree.change_log()) {
    if (!log_) raise_invalid("the tree has no change log (max_log_bytes)", "max_log_bytes");
  }

  Seq start() { return log_->start(); }
  void stop() { log_->stop(); }
  void wake() { log_->wake(); }
  [[nodiscard]] Seq last() const { return log_->last_drawn(); }
  [[nodiscard]] std::uint64_t bytes() const { return log_->bytes(); }

  void wait(double timeout_s) {
    const auto time = std::chrono::duration<double>(std::clamp(timeout_s, 0.0, 3600.0));
    const GilReleased released;
    log_->wait(ChangeLog::Clock::now() +
               std::chrono::duration_cast<ChangeLog::Clock::duration>(time));
  }

  // (first, last, lost, columns): columns is None if nothing has changed.
  nb::tuple take(std::size_t most_bytes) {
    std::optional<ChangeLog::Taken> taken;
    std::optional<Columns> columns;
    {
      const GilReleased released;
      taken = log_->take(most_bytes);
      columns.emplace(taken->entries);
    }
    nb::object found = nb::none();
    if (!taken->entries.empty())
      found = nb::make_tuple(texts_of(columns->names.texts()),
                             texts_of(columns->authorities.texts()), array_of(columns->kind),
                             array_of(columns->frame), array_of(columns->version),
                             array_of(columns->parent), array_of(columns->authority),
                             array_of(columns->stamp), poses_of(columns->pose));
    return nb::make_tuple(taken->first, taken->last, taken->lost, found);
  }

  // (seq, ever_reparented, bounds)
  nb::tuple plan_snapshot(std::size_t piece_bytes) {
    std::optional<SnapshotPlan> plan;
    {
      const GilReleased released;
      plan = SnapshotReader(tree_).plan(piece_bytes);
    }
    return nb::make_tuple(plan->seq, plan->ever_reparented, array_of(plan->bounds));
  }

  // The fields of wire.FrameColumns.
  nb::tuple read_snapshot(FrameId after, FrameId last) {
    std::optional<SnapshotPiece> piece;
    {
      const GilReleased released;
      piece = SnapshotReader(tree_).read(after, last);
    }
    return nb::make_tuple(texts_of(piece->names), texts_of(piece->authorities),
                          array_of(piece->frame), array_of(piece->version),
                          array_of(piece->is_static), array_of(piece->authority),
                          array_of(piece->count), array_of(piece->stamp), array_of(piece->parent),
                          poses_of(piece->pose));
  }

 private:
  Tree& tree_;
  ChangeLog* const log_;
};

}  // namespace

void bind_change_log(nb::module_& m) {
  nb::class_<Consumer>(m, "ChangeLog", "Reads a tree's change log and its snapshots.")
      .def(nb::init<Tree&>(), nb::arg("tree"), nb::keep_alive<1, 2>())
      .def("start", &Consumer::start)
      .def("stop", &Consumer::stop, nb::call_guard<GilReleased>())
      .def("wait", &Consumer::wait, nb::arg("timeout_s"))
      .def("wake", &Consumer::wake)
      .def("take", &Consumer::take, nb::arg("most_bytes"))
      .def("plan_snapshot", &Consumer::plan_snapshot, nb::arg("piece_bytes"))
      .def("read_snapshot", &Consumer::read_snapshot, nb::arg("after"), nb::arg("last"))
      .def_prop_ro("last", &Consumer::last)
      .def_prop_ro("bytes", &Consumer::bytes);
}

}  // namespace ztf
