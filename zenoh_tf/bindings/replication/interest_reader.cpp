// InterestReader: what an interested mirror has, and waiting until some of it has changed.
//
// GIL: what may wait, for changes or for a read in progress, releases it.
#include "replication/interest_reader.hpp"

#include <nanobind/stl/pair.h>

#include <chrono>
#include <thread>

#include "bindings/bindings.hpp"
#include "replication/message.hpp"

namespace ztf {

namespace {

class Interest {
 public:
  Interest(Tree& tree, InterestReader::Pairs pairs, bool newest_only)
      : reader_(checked(tree), std::move(pairs), newest_only) {}

  // (seq, ever_reparented, changes, all)
  nb::tuple read(bool with_all, std::size_t max_frames) {
    std::optional<std::string> changes, all;
    const InterestReader::Result result = rejected_as_error([&] {
      const GilReleased released;
      InterestReader::Result found = reader_.read(with_all, max_frames);
      if (!found.changes.kind.empty()) changes = pack(found.changes.view());
      if (with_all) all = pack(found.all.view());
      return found;
    });
    return nb::make_tuple(result.seq, result.ever_reparented, bytes_of(changes), bytes_of(all));
  }
  [[nodiscard]] bool has_changed() const { return reader_.has_changed(); }
  [[nodiscard]] std::size_t frames() const { return reader_.frames(); }

 private:
  static TreeState& checked(Tree& tree) {
    if (!tree.change_log()) raise_invalid("the tree has no change log (max_log_bytes)", "tree");
    return tree.state();
  }

  InterestReader reader_;
};

// Returns the indices of those that have changed, at once or as soon as there is one; none when the
// time is up. It compares the frames' versions once every `period_s`, so commits need not notify.
std::vector<std::size_t> wait_for_changes(const nb::list& interests, double period_s,
                                          double timeout_s) {
  using Seconds = std::chrono::duration<double>;
  std::vector<const Interest*> watched;
  for (const nb::handle one : interests) watched.push_back(nb::cast<const Interest*>(one));
  std::vector<std::size_t> changed;
  {
    const GilReleased released;
    const auto end = std::chrono::steady_clock::now() + Seconds(timeout_s);
    for (;;) {
      for (std::size_t i = 0; i < watched.size(); ++i)
        if (watched[i]->has_changed()) changed.push_back(i);
      const Seconds left = end - std::chrono::steady_clock::now();
      if (!changed.empty() || left.count() <= 0) break;
      std::this_thread::sleep_for(std::min(left, Seconds(period_s)));
    }
  }
  return changed;
}

}  // namespace

void bind_interest_reader(nb::module_& m) {
  nb::class_<Interest>(m, "InterestReader", "Reads what an interested mirror has of a tree.")
      .def(nb::init<Tree&, InterestReader::Pairs, bool>(), nb::arg("tree"), nb::arg("pairs"),
           nb::arg("newest_only"), nb::keep_alive<1, 2>())
      .def("read", &Interest::read, nb::arg("with_all"), nb::arg("max_frames"))
      .def("has_changed",
           [](const Interest& self) {
             const GilReleased released;
             return self.has_changed();
           })
      .def_prop_ro("frames", &Interest::frames);
  m.def("wait_for_changes", &wait_for_changes, nb::arg("interests"), nb::arg("period_s"),
        nb::arg("timeout_s"));
}

}  // namespace ztf
