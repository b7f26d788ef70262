// TransformRows: made from arrays, from a message's columns, from values, or from other rows; read
// as arrays, which are views of its rows, or as a message's columns.
//
// GIL: many rows are copied without it.
#include "bindings/commits/transform_rows.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "bindings/messages/message_names.hpp"

namespace ztf {

namespace {

constexpr std::size_t kReleaseFrom = 10'000;  // rows whose columns take long to copy

// Calls copy(i) for each row.
template <class Copy>
void for_each_row(std::size_t rows, Copy&& copy) {
  without_gil_if(rows >= kReleaseFrom, [&] {
    for (std::size_t i = 0; i < rows; ++i) copy(i);
  });
}

TransformRows from_arrays(nb::handle names, const Column<std::uint32_t>& parent,
                          const Column<std::uint32_t>& child, const Column<Stamp>& stamp,
                          const PoseColumn& pose) {
  const std::size_t n = parent.shape(0);
  fit(child, n, "child");
  fit(stamp, n, "stamp_ns");
  fit(pose, n, "pose");
  nb::list list;
  for (const nb::handle name : tuple_of(names)) list.append(name);
  const std::size_t count = list.size();
  std::vector<Row> rows(n);
  rejected_as_error([&] {
    for_each_row(n, [&](std::size_t i) {
      check_index(rows[i].parent = parent(i), count, "parent");
      check_index(rows[i].child = child(i), count, "child");
      rows[i].stamp = stamp(i);
      rows[i].pose = span_of(pose)[i];
    });
  });
  return {std::move(list), std::move(rows)};
}

// The bytes of a column; nullopt if it is none.
std::optional<std::string_view> column_of(nb::handle column) {
  if (!PyBytes_CheckExact(column.ptr())) return {};
  const nb::bytes bytes = nb::borrow<nb::bytes>(column);
  return std::string_view(bytes.c_str(), bytes.size());
}

nb::object parse(nb::handle names, nb::handle parent, nb::handle child, nb::handle stamp,
                 nb::handle pose) {
  if (!nb::isinstance<nb::list>(names)) return nb::none();
  const nb::list list = nb::borrow<nb::list>(names);
  for (const nb::handle name : list)
    if (!PyUnicode_Check(name.ptr())) return nb::none();
  const auto parents = column_of(parent), children = column_of(child);
  const auto stamps = column_of(stamp), poses = column_of(pose);
  if (!parents || !children || !stamps || !poses) return nb::none();
  const RowColumns columns{*parents, *children, *stamps, *poses};
  const std::size_t count = list.size();
  auto rows = without_gil_if(stamps->size() >= kReleaseFrom * sizeof(Stamp),
                             [&] { return rows_of(columns, count); });
  if (!rows) return nb::none();
  return nb::cast(TransformRows(list, std::move(*rows)));
}

// Rows that are added one by one.
class Builder {
 public:
  explicit Builder(std::size_t rows) { rows_.reserve(rows); }
  void add(nb::handle parent, nb::handle child, Stamp stamp, const Pose& pose) {
    const std::uint32_t parent_index = names_.index_of(parent);
    rows_.push_back({parent_index, names_.index_of(child), stamp, pose});
  }
  TransformRows take() { return {names_.list(), std::move(rows_)}; }

 private:
  MessageNames names_;
  std::vector<Row> rows_;
};

TransformRows of(nb::handle stampeds) {
  const nb::tuple items = tuple_of(stampeds);
  Builder rows(items.size());
  for_each_stamped(items, [&](const StampedTransform& s) {
    rows.add(s.parent_frame, s.child_frame, s.stamp, s.pose);
  });
  return rows.take();
}

TransformRows of_tuples(nb::handle tuples) {
  const nb::tuple items = tuple_of(tuples);
  Builder rows(items.size());
  for (const nb::handle item : items) {
    const auto [parent, child, stamp, pose] =
        nb::cast<std::tuple<nb::object, nb::object, Stamp, std::array<double, 7>>>(item);
    rows.add(parent, child, stamp, std::bit_cast<Pose>(pose));
  }
  return rows.take();
}

TransformRows join(nb::handle parts) {
  MessageNames names;
  std::vector<Row> rows;
  for (const nb::handle part : tuple_of(parts)) {
    const auto& added = nb::cast<const TransformRows&>(part);
    std::vector<std::uint32_t> index;
    const nb::tuple added_names = added.kept_names();
    for (const nb::handle name : added_names) index.push_back(names.index_of(name));
    for (Row row : added.rows()) {
      row.parent = index[row.parent];
      row.child = index[row.child];
      rows.push_back(row);
    }
  }
  return {names.list(), std::move(rows)};
}

// Rows with the names of `of`, without unused ones if these are many: to commit or to encode rows
// costs time for every name.
TransformRows selected(const TransformRows& of, std::vector<Row> rows) {
  if (2 * rows.size() >= of.texts().size()) return {of.names(), std::move(rows)};
  const nb::tuple all = of.kept_names();
  nb::list names;
  std::unordered_map<std::uint32_t, std::uint32_t> known;
  const auto renumber = [&](std::uint32_t& name) {
    const auto [at, is_new] = known.try_emplace(name, static_cast<std::uint32_t>(known.size()));
    if (is_new) names.append(all[name]);
    name = at->second;
  };
  for (Row& row : rows) {
    renumber(row.parent);
    renumber(row.child);
  }
  return {std::move(names), std::move(rows)};
}

TransformRows slice(const TransformRows& self, const nb::slice& which) {
  const auto [start, stop, step, length] = which.compute(self.rows().size());
  std::vector<Row> rows;
  rows.reserve(length);
  for (Py_ssize_t at = start; rows.size() < length; at += step)
    rows.push_back(self.rows()[static_cast<std::size_t>(at)]);
  return selected(self, std::move(rows));
}

TransformRows take(const TransformRows& self, const Column<std::int64_t>& which) {
  std::vector<Row> rows;
  rows.reserve(which.shape(0));
  for (const std::int64_t row : span_of(which)) {
    if (row < 0 || static_cast<std::size_t>(row) >= self.rows().size())
      raise_invalid("there is no row " + std::to_string(row), "rows");
    rows.push_back(self.rows()[static_cast<std::size_t>(row)]);
  }
  return selected(self, std::move(rows));
}

// A field of every row as an array, which keeps the rows alive.
template <class T>
nb::object view(nb::handle self, const T Row::* field) {
  const std::span<const Row> rows = nb::cast<const TransformRows&>(self).rows();
  const T* const first = rows.empty() ? nullptr : &(rows[0].*field);
  const std::size_t shape[] = {rows.size()};
  const std::int64_t strides[] = {sizeof(Row) / sizeof(T)};
  return nb::cast(nb::ndarray<nb::numpy, const T>(first, 1, shape, self, strides));
}

nb::object poses(nb::handle self) {
  const std::span<const Row> rows = nb::cast<const TransformRows&>(self).rows();
  const double* const first = rows.empty() ? nullptr : &rows[0].pose.x;
  const std::size_t shape[] = {rows.size(), 7};
  const std::int64_t strides[] = {sizeof(Row) / sizeof(double), 1};
  return nb::cast(nb::ndarray<nb::numpy, const double>(first, 2, shape, self, strides));
}

template <class T>
nb::object packed(std::span<const Row> rows, const T Row::* field) {
  const auto size = static_cast<Py_ssize_t>(rows.size() * sizeof(T));
  const nb::object bytes = nb::steal(PyBytes_FromStringAndSize(nullptr, size));
  if (!bytes.is_valid()) throw nb::python_error();
  char* const out = PyBytes_AsString(bytes.ptr());  // nobody else sees it yet
  for_each_row(rows.size(), [&](std::size_t i) {
    std::memcpy(out + i * sizeof(T), &(rows[i].*field), sizeof(T));
  });
  return bytes;
}

nb::tuple columns(const TransformRows& self) {
  const std::span<const Row> rows = self.rows();
  return nb::make_tuple(packed(rows, &Row::parent), packed(rows, &Row::child),
                        packed(rows, &Row::stamp), packed(rows, &Row::pose));
}

Stamp newest_stamp(const TransformRows& self) {
  Stamp newest = kNoStamp;
  for (const Row& row : self.rows()) newest = std::max(newest, row.stamp);
  return newest;
}

// A name's text apart: its Python object, and its place in a list, a tuple and a vector of views.
constexpr std::size_t kBytesOfName = 88;

std::size_t nbytes(const TransformRows& self) {
  std::size_t size = self.rows().size_bytes();
  for (const std::string_view text : self.texts()) size += kBytesOfName + text.size();
  return size;
}

}  // namespace

TransformRows::TransformRows(nb::list names, std::vector<Row> rows)
    : names_(std::move(names)), kept_(tuple_of(names_)), rows_(std::move(rows)) {
  const nb::tuple kept = kept_names();
  texts_.reserve(kept.size());
  for (const nb::handle name : kept) texts_.push_back(text_of(name, "names"));
}

TransformRows::TransformRows(nb::object owner, std::vector<std::string_view> texts,
                             std::vector<Row> rows)
    : owner_(std::move(owner)), texts_(std::move(texts)), rows_(std::move(rows)) {}

nb::list TransformRows::names() const {
  if (!names_.is_valid()) make_names();
  return nb::borrow<nb::list>(names_);
}

nb::tuple TransformRows::kept_names() const {
  if (!names_.is_valid()) make_names();
  return nb::borrow<nb::tuple>(kept_);
}

void TransformRows::make_names() const {
  nb::list names;
  for (const std::string_view text : texts_) names.append(str_of(text));
  nb::tuple kept = tuple_of(names);
  if (names_.is_valid()) return;  // another thread came before, while Python made the names
  kept_ = std::move(kept);
  names_ = std::move(names);
}

void bind_transform_rows(nb::module_& m) {
  nb::class_<TransformRows>(m, "TransformRows")
      .def(nb::new_(&from_arrays), nb::arg("names"), nb::arg("parent"), nb::arg("child"),
           nb::arg("stamp_ns"), nb::arg("pose"))
      .def_static("of", &of, nb::arg("stampeds"))
      .def_static("of_tuples", &of_tuples, nb::arg("tuples"))
      .def_static("join", &join, nb::arg("parts"))
      .def_static("parse", &parse, nb::arg("names").none(), nb::arg("parent").none(),
                  nb::arg("child").none(), nb::arg("stamp").none(), nb::arg("pose").none())
      .def("__getitem__", &slice, nb::arg("rows"))
      .def("__getitem__", &take, nb::arg("rows"))
      .def("columns", &columns)
      .def("__len__", [](const TransformRows& self) { return self.rows().size(); })
      .def_prop_ro("names", [](const TransformRows& self) { return self.names(); })
      .def_prop_ro("name_count", [](const TransformRows& self) { return self.texts().size(); })
      .def_prop_ro("parent", [](nb::handle self) { return view(self, &Row::parent); })
      .def_prop_ro("child", [](nb::handle self) { return view(self, &Row::child); })
      .def_prop_ro("stamp", [](nb::handle self) { return view(self, &Row::stamp); })
      .def_prop_ro("pose", &poses)
      .def_prop_ro("newest_stamp", &newest_stamp)
      .def_prop_ro("nbytes", &nbytes);
}

}  // namespace ztf
