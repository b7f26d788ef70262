// ChangeLog: the consumer of a tree's change log, and the reader of its snapshots.
//
// GIL: waiting, and reading a snapshot, release it.
#include "bindings/bindings.hpp"
#include "replication/message.hpp"
#include "replication/snapshot.hpp"

namespace ztf {

namespace {

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

  // (first, last, lost, changes): None if nothing has changed.
  nb::tuple take(std::size_t most_bytes) {
    std::optional<ChangeLog::Taken> taken;
    std::optional<std::string> changes;
    {
      const GilReleased released;
      taken = log_->take(most_bytes);
      if (!taken->entries.empty()) changes = pack(changes_of(taken->entries).view());
    }
    return nb::make_tuple(taken->first, taken->last, taken->lost, bytes_of(changes));
  }

  // (seq, ever_reparented, bounds)
  nb::tuple plan_snapshot(std::size_t piece_bytes) {
    std::optional<SnapshotPlan> plan;
    {
      const GilReleased released;
      plan = SnapshotReader(tree_.state()).plan(piece_bytes);
    }
    return nb::make_tuple(plan->seq, plan->ever_reparented, array_of(plan->bounds));
  }

  // (reached, frames)
  nb::tuple read_snapshot(FrameId after, FrameId last, std::size_t most_bytes) {
    FrameId reached = 0;
    std::optional<std::string> frames;
    {
      const GilReleased released;
      const SnapshotPiece piece = SnapshotReader(tree_.state()).read(after, last, most_bytes);
      reached = piece.reached;
      frames = pack(piece.frames.view());
    }
    return nb::make_tuple(reached, bytes_of(frames));
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
      .def("read_snapshot", &Consumer::read_snapshot, nb::arg("after"), nb::arg("last"),
           nb::arg("most_bytes"))
      .def_prop_ro("last", &Consumer::last)
      .def_prop_ro("nbytes", &Consumer::bytes);
}

}  // namespace ztf
