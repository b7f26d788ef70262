// The reply to a lookup: answers as columns, and the errors of rows that failed.
#include <algorithm>
#include <limits>

#include "bindings/lookup_error.hpp"
#include "bindings/reads/read_rows.hpp"

namespace ztf {

namespace {

// Errors of a reply that suggest other names, which takes longer than all the rest of an error.
constexpr std::size_t kMostSuggestions = 3;
// Errors that are made before other threads get the GIL.
constexpr std::size_t kErrorsAtOnce = 100;
constexpr std::uint64_t kErrorBytes = 100;  // of an error in a reply, without names and numbers

// True if the two rows fail alike, so that they can share an error.
bool same_failure(const ReadRows& rows, const AnswerColumns::Failed& i,
                  const AnswerColumns::Failed& j) {
  const Failure &a = i.failure, &b = j.failure;
  const ReadRows::Names &x = rows.names[i.row], &y = rows.names[j.row];
  return a.code == b.code && a.stamp == b.stamp && a.frame == b.frame && a.oldest == b.oldest &&
         a.newest == b.newest && a.max_gap == b.max_gap && a.target == b.target &&
         a.source == b.source && a.parent == b.parent && a.target_root == b.target_root &&
         a.source_root == b.source_root && x.target == y.target && x.source == y.source &&
         x.fixed == y.fixed && rows.queries[i.row].op == rows.queries[j.row].op;
}

// The error of a row that failed.
template <class AnyTree>
nb::object error_of_row(const AnyTree& tree, const ReadRows& rows,
                        const AnswerColumns::Failed& failed, const std::string& text,
                        bool suggest) {
  const auto& [i, failure] = failed;
  if (rows.has_invalid_name(i)) return rows.name_error(tree, i);
  if (failure.code == Code::limit) {  // only of a waiting lookup
    nb::dict facts;
    facts["field"] = "waiter_links";
    return make_error(Code::limit, text, facts);
  }
  auto [target, source, fixed] = rows.names[i];
  // A full lookup failed in one of its halves: source in fixed, or fixed in target.
  if (rows.queries[i].op == Op::full)
    (failure.target == rows.queries[i].fixed ? target : source) = fixed;
  const Query& query = rows.queries[i];
  const bool first_half = target == fixed;
  const bool latest = query.op == Op::full
                          ? (first_half ? query.source_stamp : query.stamp) == kNoStamp
                          : query.op == Op::latest_common;
  return make_error(
      tree, failure, rows.name_objects[target], rows.name_objects[source],
      {.waited = text, .latest = latest, .may_wait = rows.queries.size() == 1, .suggest = suggest});
}

}  // namespace

AnswerColumns::AnswerColumns(std::size_t rows, const FailureReport& report)
    : size(rows),
      status(std::make_unique_for_overwrite<std::uint8_t[]>(size)),
      stamp(std::make_unique_for_overwrite<Stamp[]>(size)),
      newest(std::make_unique_for_overwrite<Stamp[]>(size)),
      pose(std::make_unique_for_overwrite<double[]>(7 * size)),
      most_failed_(report.errors ? size : 0),
      is_starting_(report.is_starting) {
  if (report.budget)
    most_failed_ =
        std::min<std::size_t>(most_failed_, report.budget->error_bytes / kErrorBytes + 1);
}

bool AnswerColumns::add(const ReadRows& rows, std::size_t first, std::span<const Answer> answers) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  bool any_failed = false;
  double* d = pose.get() + 7 * first;
  for (std::size_t i = first; i < first + answers.size(); ++i) {
    const Answer& a = answers[i - first];
    stamp[i] = a.stamp;
    newest[i] = a.newest;
    if (a.gap != 0) [[unlikely]] {
      if (!gap) gap = std::make_unique<Stamp[]>(size);
      gap[i] = a.gap;
    }
    if (a.failure.code == Code::ok) [[likely]] {
      status[i] = 0;
      d = std::copy_n(&a.pose.x, 7, d);
      continue;
    }
    const Code code = rows.has_invalid_name(i) ? Code::invalid_argument : a.failure.code;
    const Code shown = rows.has_invalid_name(i) ? code : shown_code(a.failure, is_starting_);
    status[i] = static_cast<std::uint8_t>(shown);
    d = std::fill_n(d, 7, nan);
    any_failed = true;
    if (failed.size() < most_failed_) {
      failed.push_back({i, a.failure});
      failed.back().failure.code = code;
    }
  }
  return any_failed;
}

template <class AnyTree>
nb::tuple reply(const AnyTree& tree, const ReadRows& rows, AnswerColumns&& columns,
                const FailureReport& report, const nb::object& reads) {
  nb::list failures;
  nb::object error;
  const AnswerColumns::Failed* first = nullptr;  // that has this error
  std::uint64_t bytes = 0;
  std::size_t made = 0;
  for (const AnswerColumns::Failed& each : columns.failed) {
    if (!first || !report.notes.empty() || !same_failure(rows, each, *first)) {
      if (++made % kErrorsAtOnce == 0) const GilReleased for_others;
      error = error_of_row(tree, rows, each, report.notes.empty() ? "" : report.notes[each.row],
                           made <= kMostSuggestions);
      first = &each;
      // The message holds the names and numbers that are also facts.
      bytes = kErrorBytes + 2 * nb::cast<std::string>(nb::str(error)).size();
    }
    if (report.budget) {
      if (bytes > report.budget->error_bytes) break;
      report.budget->error_bytes -= bytes;
    }
    failures.append(nb::make_tuple(each.row, error));
  }
  const std::size_t n = columns.size;
  return nb::make_tuple(
      array_of(std::move(columns.status), {n}), array_of(std::move(columns.stamp), {n}),
      array_of(std::move(columns.newest), {n}), array_of(std::move(columns.pose), {n, 7}), failures,
      reads, columns.gap ? array_of(std::move(columns.gap), {n}) : nb::none());
}

template nb::tuple reply(const Tree&, const ReadRows&, AnswerColumns&&, const FailureReport&,
                         const nb::object&);
template nb::tuple reply(const SharedTree&, const ReadRows&, AnswerColumns&&, const FailureReport&,
                         const nb::object&);

}  // namespace ztf
