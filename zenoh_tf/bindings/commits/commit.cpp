// Tree._commit_rows: a transaction of many rows.
//
// GIL: released by commits of more than a few rows.
#include "bindings/commits/transform_rows.hpp"
#include "bindings/reads/read_rows.hpp"

namespace ztf {

namespace {

nb::bytes commit_rows(Tree& tree, const TransformRows& rows, std::string_view authority,
                      bool is_static, bool drop_old, nb::handle read_names,
                      std::optional<Column<Version>> read_versions,
                      std::optional<std::int64_t> expires, std::optional<Stamp> max_stamp) {
  check_name_bytes(tree, rows.texts());
  std::vector<std::string_view> read_texts;
  const std::vector<nb::object> read_objects = names_of(tree, read_names, read_texts, "read_names");
  if ((read_versions ? read_versions->shape(0) : 0) != read_texts.size())
    raise_invalid("read_versions must have as many rows as read_names", "read_versions");
  std::vector<std::uint8_t> stored(rows.rows().size());
  CommitRequest request{.names = rows.texts(),
                        .rows = rows.rows(),
                        .authority = authority,
                        .is_static = is_static,
                        .drop_old = drop_old,
                        .read_names = read_texts};
  if (read_versions) request.read_versions = {read_versions->data(), read_texts.size()};
  if (expires) request.expires_ns = *expires;
  if (max_stamp) request.max_stamp = *max_stamp;
  commit(tree, request, stored);
  return nb::bytes(reinterpret_cast<const char*>(stored.data()), stored.size());
}

}  // namespace

void bind_commit(nb::class_<Tree>& tree) {
  tree.def("_commit_rows", &commit_rows, nb::arg("rows"), nb::kw_only(), nb::arg("authority") = "",
           nb::arg("static") = false, nb::arg("drop_old") = false,
           nb::arg("read_names") = nb::make_tuple(), nb::arg("read_versions").none() = nb::none(),
           nb::arg("expires_ns").none() = nb::none(), nb::arg("max_stamp_ns").none() = nb::none());
}

}  // namespace ztf
