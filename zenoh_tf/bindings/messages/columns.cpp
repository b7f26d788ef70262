// columns_of_pairs: the arguments of a lookup as the columns of a message.
//
// GIL: kept.
#include "bindings/messages/message_names.hpp"

namespace ztf {

namespace {

nb::object index_array(MessageNames& names, nb::handle given, std::size_t rows, const char* field) {
  const NameColumn column(names, given, field);
  if (column.is_single())
    return array_of(std::vector<std::uint32_t>(rows, column.indexes().front()));
  if (column.size() != rows)
    raise_invalid(std::string(field) + " has " + std::to_string(column.size()) + " names for " +
                      std::to_string(rows) + " rows",
                  field);
  return array_of(column.indexes());
}

nb::tuple columns_of_pairs(nb::handle targets, nb::handle sources, std::size_t rows) {
  MessageNames names;
  const nb::object target = index_array(names, targets, rows, "targets");
  const nb::object source = index_array(names, sources, rows, "sources");
  return nb::make_tuple(names.list(), target, source);
}

}  // namespace

void bind_columns(nb::module_& m) {
  m.def("columns_of_pairs", &columns_of_pairs, nb::arg("targets"), nb::arg("sources"),
        nb::arg("rows"));
}

}  // namespace ztf
