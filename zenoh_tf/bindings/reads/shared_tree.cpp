// SharedTree: the base class of zenoh_tf.shared_tree.SharedTree. LeaseKeeper, for the tree's owner.
//
// GIL: as in tree.cpp.
#include "bindings/bindings.hpp"
#include "records/layout.hpp"
#include "shared/lease.hpp"
#include "system/host.hpp"

namespace ztf {

namespace {

double lease_left_s(const SharedTree& tree) {
  return static_cast<double>(tree.lease_ns() - monotonic_ns()) * 1e-9;
}

struct Lease {
  explicit Lease(Tree& tree) : keeper(std::in_place, tree.state()) {}
  void end() { keeper.reset(); }
  std::optional<LeaseKeeper> keeper;
};

}  // namespace

void bind_shared_tree(nb::module_& m) {
  using Reason = Unanswered::Reason;
  nb::enum_<Reason>(m, "AskServer")
      .value("BUSY", Reason::busy)
      .value("LAPSED", Reason::lapsed)
      .value("WAITING", Reason::waiting)
      .value("UNREADABLE", Reason::unreadable)
      .value("ABSENT", Reason::absent);
  // In the place of every method of a tree that is not mapped. Native, as each query passes it.
  m.def("ask_absent", [](const nb::args&, const nb::kwargs&) { return Reason::absent; });
  nb::exception<RegionRefused>(m, "RegionRefused", PyExc_ValueError);

  m.attr("LAYOUT") = nb::make_tuple(kLayoutVersion, kLayoutHash);

  nb::class_<Lease>(m, "LeaseKeeper")
      .def(nb::init<Tree&>(), nb::arg("tree"), nb::keep_alive<1, 2>())
      .def("end", &Lease::end);

  nb::class_<SharedTree> tree(m, "SharedTree", nb::is_weak_referenceable());
  tree.def(nb::init<int>(), nb::arg("fd"))
      .def_prop_ro("instance", [](const SharedTree& t) { return t.options().instance; })
      .def_prop_ro("lease_left_s", &lease_left_s);
  bind_reads(tree);
}

}  // namespace ztf
