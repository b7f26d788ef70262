// Tree._commit_rows: a transaction as columns, for the server.
//
// GIL: commits release it.
#include <algorithm>

#include "read_rows.hpp"

namespace ztf {

namespace {

constexpr std::size_t kReleaseFrom = 10'000;  // rows whose columns take long to read

nb::object commit_rows(Tree& tree, nb::handle names, const Column<std::uint32_t>& parent,
                       const Column<std::uint32_t>& child, const Column<Stamp>& stamp,
                       const PoseColumn& pose, std::string_view authority, bool is_static,
                       bool drop_old, nb::handle read_names,
                       std::optional<Column<Version>> read_versions,
                       std::optional<std::int64_t> expires, std::optional<Stamp> max_stamp) {
  std::vector<std::string_view> texts, read_texts;
  const std::vector<nb::object> objects = names_of(tree, names, texts, "names");
  const std::vector<nb::object> read_objects = names_of(tree, read_names, read_texts, "read_names");
  const std::size_t n = parent.shape(0);
  fit(child, n, "child");
  fit(stamp, n, "stamp_ns");
  if (pose.shape(0) != n) raise_invalid("pose must have as many rows as parent", "pose");
  if ((read_versions ? read_versions->shape(0) : 0) != read_texts.size())
    raise_invalid("read_versions must have as many rows as read_names", "read_versions");
  std::vector<Row> rows;
  rejected_as_error([&] {
    std::optional<GilReleased> released;
    if (n >= kReleaseFrom) released.emplace();
    rows.resize(n);
    for (std::size_t i = 0; i < n; ++i)
      rows[i] = {
          checked(parent(i), texts.size(), "parent"),
          checked(child(i), texts.size(), "child"),
          stamp(i),
          {pose(i, 0), pose(i, 1), pose(i, 2), pose(i, 3), pose(i, 4), pose(i, 5), pose(i, 6)}};
  });
  std::vector<std::uint8_t> stored(n);
  CommitRequest request{.names = texts,
                        .rows = rows,
                        .authority = authority,
                        .is_static = is_static,
                        .drop_old = drop_old,
                        .read_names = read_texts};
  if (read_versions) request.read_versions = {read_versions->data(), read_texts.size()};
  if (expires) request.expires_ns = *expires;
  if (max_stamp) request.max_stamp = *max_stamp;
  commit(tree, request, stored, true);
  return make_array<std::uint8_t>(
      {n}, [&](std::uint8_t* d) { std::copy(stored.begin(), stored.end(), d); });
}

}  // namespace

void bind_commit(nb::class_<Tree>& tree) {
  tree.def("_commit_rows", &commit_rows, nb::arg("names"), nb::arg("parent"), nb::arg("child"),
           nb::arg("stamp_ns"), nb::arg("pose"), nb::kw_only(), nb::arg("authority") = "",
           nb::arg("static") = false, nb::arg("drop_old") = false,
           nb::arg("read_names") = nb::make_tuple(), nb::arg("read_versions").none() = nb::none(),
           nb::arg("expires_ns").none() = nb::none(), nb::arg("max_stamp_ns").none() = nb::none());
}

}  // namespace ztf
