// Waiting lookups that occupy no thread: ParkedLookups and WakeQueue.
//
// GIL: released while a thread looks rows up or sleeps. Lookups are destroyed under it.
#include "by_name/parked.hpp"

#include <nanobind/stl/shared_ptr.h>

#include "bindings/reads/answer_columns.hpp"

namespace ztf {

namespace {

// What the rows refer to: the tree, even if only the queue keeps them alive, names and columns.
struct Kept {
  nb::object tree;
  nb::tuple names;
  ReadColumns columns;
};

class ParkedLookups final : private Kept, public ParkedRows {
 public:
  ParkedLookups(Kept kept, WakeQueue& queue, LookupRows rows, std::uint64_t lookup_id,
                std::size_t max_links)
      : Kept(std::move(kept)),
        ParkedRows(nb::cast<const Tree&>(Kept::tree), queue, std::move(rows), lookup_id,
                   max_links) {}
  ~ParkedLookups() override { cancel_on_wait(); }

  void cancel_on_wait() {
    const GilReleasedOnWait released;
    cancel();
  }
  // As of _read_rows.
  nb::tuple reply(double waited_s, bool errors, Budget* budget) {
    const Tree& tree = ParkedRows::tree();
    Result found = [&] {
      const GilReleasedOnWait released;
      return result(waited_s);
    }();
    const FailureReport report{!tree.startup().is_over(), errors, budget, std::move(found.notes)};
    AnswerColumns columns(found.answers.size(), report);
    columns.add(rows(), 0, found.answers);
    return ztf::reply(tree, rows(), std::move(columns), report, nb::none());
  }
};

}  // namespace

void bind_parked_lookups(nb::module_& m) {
  nb::class_<WakeQueue>(m, "WakeQueue", docs::WakeQueue.text)
      .def(nb::init<>())
      .def(
          "take",
          [](WakeQueue& queue) {
            WakeQueue::Owners owners;
            const GilReleased released;
            return queue.take(owners);
          },
          ZTF_DOC(WakeQueue_take))
      .def("close", &WakeQueue::close);

  nb::class_<ParkedLookups>(m, "ParkedLookups", docs::ParkedLookups.text)
      .def("start", &ParkedLookups::start, ZTF_DOC(ParkedLookups_start),
           nb::call_guard<GilReleased>())
      .def("cancel", &ParkedLookups::cancel_on_wait)
      .def("links", &ParkedLookups::links, nb::call_guard<GilReleased>())
      .def("result", &ParkedLookups::reply, ZTF_DOC(ParkedLookups_result), nb::arg("waited_s"),
           nb::arg("errors") = true, nb::arg("budget").none() = nb::none());
  m.def(
      "park_lookups",
      [](nb::object tree, WakeQueue& queue, std::uint64_t lookup_id, nb::handle names,
         const Column<std::uint8_t>& op, const Column<std::uint32_t>& target,
         const Column<std::uint32_t>& source, const Column<Stamp>& stamp,
         const std::optional<Column<std::uint32_t>>& fixed,
         const std::optional<Column<Stamp>>& source_stamp, std::size_t max_links, Stamp max_gap) {
        const auto& of = nb::cast<const Tree&>(tree);
        ReadColumns columns{op, target, source, stamp, fixed, source_stamp, max_gap};
        columns.check();
        std::vector<std::string_view> texts;
        nb::tuple kept = names_of(of.options(), names, texts, "names");
        LookupRows rows(std::move(texts));
        rejected_as_error([&] { columns.set(rows); });
        Kept refers_to{std::move(tree), std::move(kept), std::move(columns)};
        return std::make_shared<ParkedLookups>(std::move(refers_to), queue, std::move(rows),
                                               lookup_id, max_links);
      },
      nb::arg("tree"), nb::arg("queue"), nb::arg("lookup_id"), nb::arg("names"), nb::arg("op"),
      nb::arg("target"), nb::arg("source"), nb::arg("stamp_ns"),
      nb::arg("fixed").none() = nb::none(), nb::arg("source_stamp_ns").none() = nb::none(),
      nb::arg("max_links") = static_cast<std::size_t>(-1), nb::arg("max_gap_ns") = kNoGapLimit,
      nb::keep_alive<0, 2>());
}

}  // namespace ztf
