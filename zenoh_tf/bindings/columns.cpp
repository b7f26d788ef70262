// Arguments as the columns of a message, which sends each name once.
//
// GIL: kept.
#include <algorithm>
#include <string>
#include <unordered_map>

#include "bindings.hpp"

namespace ztf {

namespace {

// The names of a message, each once, in the order of their first use.
class MessageNames {
 public:
  std::uint32_t index_of(nb::handle name) {
    const auto [at, is_new] =
        known_.try_emplace(text_of(name, "frame"), static_cast<std::uint32_t>(known_.size()));
    if (is_new) list_.append(name);
    return at->second;
  }
  [[nodiscard]] const nb::list& list() const { return list_; }

 private:
  nb::list list_;  // keeps the texts alive
  std::unordered_map<std::string_view, std::uint32_t> known_;
};

nb::object column(const std::vector<std::uint32_t>& values) {
  return make_array<std::uint32_t>(
      {values.size()}, [&](std::uint32_t* d) { std::copy(values.begin(), values.end(), d); });
}

// A name for all rows, or a sequence of names.
nb::object index_column(MessageNames& names, nb::handle given, std::size_t rows,
                        const char* field) {
  if (PyUnicode_Check(given.ptr()))
    return column(std::vector<std::uint32_t>(rows, names.index_of(given)));
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
  return column(values);
}

nb::tuple columns_of_pairs(nb::handle targets, nb::handle sources, std::size_t rows) {
  MessageNames names;
  const nb::object target = index_column(names, targets, rows, "targets");
  const nb::object source = index_column(names, sources, rows, "sources");
  return nb::make_tuple(names.list(), target, source);
}

// (names, parent, child, stamp, pose): the columns of a commit.
nb::tuple columns_of(nb::handle stampeds) {
  const nb::tuple items = tuple_of(stampeds);
  std::vector<const StampedTransform*> rows;
  rows.reserve(items.size());
  for (const nb::handle item : items) {
    if (!nb::isinstance<StampedTransform>(item))
      raise_invalid("stampeds must hold StampedTransforms", "stampeds");
    rows.push_back(&nb::cast<const StampedTransform&>(item));
  }
  const std::size_t n = rows.size();
  MessageNames names;
  std::vector<std::uint32_t> parent(n), child(n);
  for (std::size_t i = 0; i < n; ++i) {
    parent[i] = names.index_of(rows[i]->parent_frame);
    child[i] = names.index_of(rows[i]->child_frame);
  }
  return nb::make_tuple(names.list(), column(parent), column(child),
                        make_array<Stamp>({n},
                                          [&](Stamp* d) {
                                            for (const StampedTransform* row : rows)
                                              *d++ = row->stamp;
                                          }),
                        make_array<double>({n, 7}, [&](double* d) {
                          for (const StampedTransform* row : rows)
                            d = std::copy_n(&row->pose.x, 7, d);
                        }));
}

}  // namespace

void bind_columns(nb::module_& m) {
  m.def("columns_of", &columns_of, nb::arg("stampeds"));
  m.def("columns_of_pairs", &columns_of_pairs, nb::arg("targets"), nb::arg("sources"),
        nb::arg("rows"));
}

}  // namespace ztf
