// Budget: limits of one message, charged before the memory or the time is spent.
#include "bindings/reads/budget.hpp"

namespace ztf {

Budget::Budget(std::uint64_t links, std::uint64_t read_set, std::uint64_t listed,
               std::uint64_t reply_bytes, std::uint64_t error_bytes)
    : links("links", "links climbed by the lookups of one message", links),
      read_set("read_set", "frames read by one lookup with `atomic` or `versions`", read_set),
      listed("listed", "names listed or frames counted for one message", listed),
      reply_bytes("reply_bytes", "bytes of one reply", reply_bytes),
      error_bytes(error_bytes) {}

void Budget::Share::exceeded(std::uint64_t value) const {
  raise(Rejected{.code = Code::limit,
                 .message = "at least " + std::to_string(value) + " " + meaning_ +
                            ": the limit is " + std::to_string(limit_),
                 .field = field_,
                 .limit = static_cast<std::int64_t>(limit_),
                 .value = static_cast<std::int64_t>(value)});
}

void bind_budget(nb::module_& m) {
  nb::class_<Budget>(m, "Budget", docs::Budget.text)
      .def(nb::init<std::uint64_t, std::uint64_t, std::uint64_t, std::uint64_t, std::uint64_t>(),
           nb::kw_only(), nb::arg("links"), nb::arg("read_set"), nb::arg("listed"),
           nb::arg("reply_bytes"), nb::arg("error_bytes"))
      .def("take_links", [](Budget& budget, std::uint64_t n) { budget.links.take(n); })
      .def("take_listed", [](Budget& budget, std::uint64_t n) { budget.listed.take(n); })
      .def("take_reply", [](Budget& budget, std::uint64_t n) { budget.reply_bytes.take(n); })
      .def_prop_ro("listed_left", [](const Budget& budget) { return budget.listed.left(); });
}

}  // namespace ztf
