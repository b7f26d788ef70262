// Tree._read_rows: lookups of every kind as columns, for the server.
//
// GIL: many rows release it, once for all that is done row by row, so that other threads wait for
// none of it. Errors are made after, under it.
#include "bindings/reads/answer_columns.hpp"
#include "records/versions.hpp"
#include "system/host.hpp"

namespace ztf {

namespace {

constexpr std::size_t kReleaseFrom = 16;  // rows from which releasing the GIL pays

// The read set: names of frames and their versions. A frame that does not exist has version 0:
// a transaction conflicts if it is created.
template <class AnyTree>
nb::object versions_of(const AnyTree& tree, const LookupRows& rows,
                       const std::vector<ReadVersion>& reads, Budget* budget) {
  std::vector<std::string> names;
  for (const ReadVersion& read : reads) names.push_back(tree.name(read.frame));
  for (const std::string_view name : rows.unknown_names()) names.emplace_back(name);
  if (budget) {
    std::uint64_t bytes = 0;
    for (const std::string& name : names) bytes += name.size() + 11;
    budget->reply_bytes.take(bytes);
  }
  std::vector<Version> versions(names.size());
  for (std::size_t i = 0; i < reads.size(); ++i) versions[i] = reads[i].version & kServerVersion;
  return nb::make_tuple(names, array_of(versions));
}

// Counts the rows that failed because a link was late. Only lookups of a server's clients are
// counted: those that have a budget.
void count_failed(const Tree& tree, std::span<const Answer> answers) {
  const std::int64_t now_ns = real_time_ns();
  for (const Answer& answer : answers) tree.count_failed(answer.failure, now_ns);
}
void count_failed(const SharedTree&, std::span<const Answer>) {}

template <class AnyTree>
nb::tuple read_rows(const AnyTree& tree, nb::handle names, const Column<std::uint8_t>& op,
                    const Column<std::uint32_t>& target, const Column<std::uint32_t>& source,
                    const Column<Stamp>& stamp, const std::optional<Column<std::uint32_t>>& fixed,
                    const std::optional<Column<Stamp>>& source_stamp, bool atomic, bool versions,
                    bool errors, Budget* budget, Stamp max_gap) {
  const ReadColumns columns{op, target, source, stamp, fixed, source_stamp, max_gap};
  columns.check();
  std::vector<std::string_view> texts;
  const nb::tuple kept = names_of(tree.options(), names, texts, "names");
  LookupRows rows(std::move(texts));
  rows.one_instant = versions;  // so that the versions of a row belong together
  const FailureReport report{!tree.startup().is_over(), errors, budget};
  std::vector<ReadVersion> reads;
  std::uint64_t links = 0;
  const std::uint64_t max_links = budget ? budget->links.left() : 0;
  std::optional<AnswerColumns> answered;
  const auto run = [&] {
    columns.set(rows);
    (void)rows.find_names(tree);
    if (budget) links = rows.links(tree, max_links);
    if (links > max_links) return;
    answered.emplace(rows.size, report);
    const auto add = [&](std::size_t first, std::span<const Answer> answers) {
      if (answered->add(rows, first, answers) && budget) count_failed(tree, answers);
    };
    if (!atomic && !versions) return rows.look_up_each(tree, add);
    std::vector<Answer> answers(rows.size);
    reads = rows.look_up_with_versions(tree, atomic, answers,
                                       budget ? budget->read_set.limit() : kNoReadLimit);
    add(0, answers);
  };
  try {
    if (op.shape(0) >= kReleaseFrom) {
      const GilReleased released;
      run();
    } else {
      const GilReleasedOnWait released;
      run();
    }
  } catch (const Rejected& rejected) {
    if (budget && rejected.code == Code::limit) budget->read_set.exhausted();
    raise(rejected);
  }
  if (budget) budget->links.take(links);
  const nb::object found = versions ? versions_of(tree, rows, reads, budget) : nb::none();
  return reply(tree, rows, std::move(*answered), report, found);
}

}  // namespace

void bind_operations(nb::module_& m) {
  m.attr("OP_AT") = static_cast<int>(Op::at);
  m.attr("OP_COMMON") = static_cast<int>(Op::latest_common);
  m.attr("OP_LATEST") = static_cast<int>(Op::latest);
  m.attr("OP_LATEST_XACT") = static_cast<int>(Op::latest_xact);
  m.attr("OP_COMMON_TIME") = static_cast<int>(Op::common_time);
  m.attr("OP_FULL") = static_cast<int>(Op::full);
  m.attr("NO_STAMP") = kNoStamp;
}

template <class T>
void bind_read_rows(nb::class_<T>& tree) {
  tree.def("_read_rows", method<&read_rows<T>>, nb::arg("names"), nb::arg("op"), nb::arg("target"),
           nb::arg("source"), nb::arg("stamp_ns"), nb::arg("fixed").none() = nb::none(),
           nb::arg("source_stamp_ns").none() = nb::none(), nb::kw_only(), nb::arg("atomic") = false,
           nb::arg("versions") = false, nb::arg("errors") = true,
           nb::arg("budget").none() = nb::none(), nb::arg("max_gap_ns") = kNoGapLimit);
}
template void bind_read_rows(nb::class_<Tree>&);
template void bind_read_rows(nb::class_<SharedTree>&);

}  // namespace ztf
