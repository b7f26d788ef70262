// Tree._commit_rows: a transaction of many rows; Tree._refusals: why some were refused.
//
// GIL: released by commits of more than a few rows.
#include <algorithm>

#include "bindings/commits/transform_rows.hpp"

namespace ztf {

namespace {

nb::bytes commit_rows(Tree& tree, const TransformRows& rows, std::string_view authority,
                      bool is_static, bool drop_old, bool drop_bad, bool drop_strays,
                      nb::handle read_names, std::optional<Column<Version>> read_versions,
                      std::optional<std::int64_t> expires, std::optional<Stamp> max_stamp) {
  std::vector<std::string_view> read_texts;
  const nb::tuple kept_names = tuple_of(read_names);  // keeps the texts alive
  for (const nb::handle name : kept_names) read_texts.push_back(text_of(name, "read_names"));
  if (!drop_bad)
    rejected_as_error([&] {
      check_name_bytes(tree.options(), rows.texts());
      check_name_bytes(tree.options(), read_texts);
    });
  if ((read_versions ? read_versions->shape(0) : 0) != read_texts.size())
    raise_invalid("read_versions must have as many rows as read_names", "read_versions");
  std::vector<std::uint8_t> stored(rows.rows().size());
  CommitRequest request{.names = rows.texts(),
                        .rows = rows.rows(),
                        .authority = authority,
                        .is_static = is_static,
                        .drop_old = drop_old,
                        .drop_bad = drop_bad,
                        .drop_strays = drop_strays,
                        .read_names = read_texts};
  if (read_versions) request.read_versions = {read_versions->data(), read_texts.size()};
  if (expires) request.expires_ns = *expires;
  if (max_stamp) request.max_stamp = *max_stamp;
  commit(tree, request, stored);
  return nb::bytes(reinterpret_cast<const char*>(stored.data()), stored.size());
}

// The errors of the rows that a commit has refused: one for each frame and reason, of the first so
// many.
nb::list refusals(const Tree& tree, const TransformRows& rows, const nb::bytes& stored) {
  constexpr std::size_t kMost = 8;
  const CommitRequest request{.names = rows.texts(), .rows = rows.rows()};
  if (stored.size() != request.rows.size())
    raise_invalid("stored must have as many bytes as there are rows", "stored");
  const auto* const results = reinterpret_cast<const std::uint8_t*>(stored.c_str());
  std::vector<std::pair<std::uint8_t, std::uint32_t>> known;
  nb::list errors;
  for (std::size_t i = 0; i < stored.size() && known.size() < kMost; ++i) {
    const Row& row = request.rows[i];
    const std::pair reason(results[i], row.child);
    if (!RowResult::is_refusal(results[i]) || std::ranges::find(known, reason) != known.end())
      continue;
    known.push_back(reason);
    errors.append(make_error(tree.rejection_of(request, row, results[i])));
  }
  return errors;
}

}  // namespace

void bind_commit(nb::class_<Tree>& tree) {
  tree.def("_commit_rows", &commit_rows, nb::arg("rows"), nb::kw_only(), nb::arg("authority") = "",
           nb::arg("static") = false, nb::arg("drop_old") = false, nb::arg("drop_bad") = false,
           nb::arg("drop_strays") = false, nb::arg("read_names") = nb::make_tuple(),
           nb::arg("read_versions").none() = nb::none(), nb::arg("expires_ns").none() = nb::none(),
           nb::arg("max_stamp_ns").none() = nb::none());
  tree.def("_refusals", &refusals, nb::arg("rows"), nb::arg("stored"));
}

}  // namespace ztf
