// columns_of_pairs: the arguments of a lookup as the columns of a message.
//
// GIL: kept.
#include <string>

#include "bindings/messages/message_names.hpp"

namespace ztf {

namespace {

// A name for all rows, or a sequence of names.
nb::object index_column(MessageNames& names, nb::handle given, std::size_t rows,
                        const char* field) {
  if (PyUnicode_Check(given.ptr()))
    return array_of(std::vector<std::uint32_t>(rows, names.index_of(given)));
  const nb::tuple items = tuple_of(given);
  if (items.size() != rows)
    raise_invalid(std::string(field) + " has " + std::to_string(items.size()) + " names for " +
                      std::to_string(rows) + " rows",
                  field);
  std::vector<std::uint32_t> values;
  values.reserve(rows);
  const PyObject* last = nullptr;  // often one str object is repeated many times in a row
  for (const nb::handle item : items) {
    values.push_back(item.ptr() == last ? values.back() : names.index_of(item));
    last = item.ptr();
  }
  return array_of(values);
}

nb::tuple columns_of_pairs(nb::handle targets, nb::handle sources, std::size_t rows) {
  MessageNames names;
  const nb::object target = index_column(names, targets, rows, "targets");
  const nb::object source = index_column(names, sources, rows, "sources");
  return nb::make_tuple(names.list(), target, source);
}

}  // namespace

void bind_columns(nb::module_& m) {
  m.def("columns_of_pairs", &columns_of_pairs, nb::arg("targets"), nb::arg("sources"),
        nb::arg("rows"));
}

}  // namespace ztf
