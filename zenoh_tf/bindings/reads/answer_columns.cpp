// The reply to a lookup: answers as columns, and the errors of rows that failed.
#include "bindings/reads/answer_columns.hpp"

#include <algorithm>
#include <cstring>
#include <limits>

namespace ztf {

namespace {

// Errors of a reply that suggest other names, which takes longer than all the rest of an error.
constexpr std::size_t kMostSuggestions = 3;
// Errors that are made before other threads get the GIL.
constexpr std::size_t kErrorsAtOnce = 100;
constexpr std::uint64_t kErrorBytes = 100;  // of an error in a reply, without names and numbers

// True if the two rows fail alike, so that they can share an error.
bool same_failure(const LookupRows& rows, const AnswerColumns::Failed& a,
                  const AnswerColumns::Failed& b) {
  const std::size_t i = a.row, j = b.row;
  return a.failure == b.failure && rows.op[i] == rows.op[j] && rows.target[i] == rows.target[j] &&
         rows.source[i] == rows.source[j] &&
         (Op{rows.op[i]} != Op::full || rows.fixed[i] == rows.fixed[j]);
}

// The error of a row that failed.
template <class AnyTree>
nb::object error_of_row(const AnyTree& tree, const LookupRows& rows,
                        const AnswerColumns::Failed& failed, const std::string& text,
                        bool suggest) {
  const auto& [row, failure] = failed;
  if (failure.code == Code::limit)  // only of a waiting lookup
    return make_error({.code = Code::limit, .message = text, .field = "waiter_links"});
  return make_error(row_error(tree, rows, row, failure, {.waited = text, .suggest = suggest}));
}

}  // namespace

void ReadColumns::check() const {
  const std::size_t n = op.shape(0);
  fit(target, n, "target");
  fit(source, n, "source");
  fit(stamp, n, "stamp_ns");
  if (fixed) fit(*fixed, n, "fixed");
  if (source_stamp) fit(*source_stamp, n, "source_stamp_ns");
}

void ReadColumns::set(LookupRows& rows) const {
  rows.size = op.shape(0);
  rows.op = {op.data()};
  rows.target = {target.data()};
  rows.source = {source.data()};
  rows.stamp = {stamp.data()};
  if (fixed) rows.fixed = {fixed->data()};
  if (source_stamp) rows.source_stamp = {source_stamp->data()};
  rows.max_gap = max_gap;
  rows.check();
}

AnswerColumns::AnswerColumns(std::size_t rows, const FailureReport& report)
    : size(rows),
      status(std::make_unique_for_overwrite<std::uint8_t[]>(size)),
      stamp(std::make_unique_for_overwrite<Stamp[]>(size)),
      newest(report.errors ? std::make_unique_for_overwrite<Stamp[]>(size) : nullptr),
      pose(std::make_unique_for_overwrite<double[]>(7 * size)),
      most_failed_(report.errors ? size : 0),
      is_starting_(report.is_starting) {
  if (report.budget)
    most_failed_ =
        std::min<std::size_t>(most_failed_, report.budget->error_bytes / kErrorBytes + 1);
}

bool AnswerColumns::add(const LookupRows& rows, std::size_t first,
                        std::span<const Answer> answers) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  bool any_failed = false;
  double* d = pose.get() + 7 * first;
  for (std::size_t i = first; i < first + answers.size(); ++i) {
    const Answer& a = answers[i - first];
    stamp[i] = a.stamp;
    if (newest) newest[i] = a.newest;
    if (a.gap != 0) [[unlikely]] {
      if (!gap) gap = std::make_unique<Stamp[]>(size);
      gap[i] = a.gap;
    }
    if (a.failure.code == Code::ok) [[likely]] {
      status[i] = 0;
      std::memcpy(d, &a.pose.x, 7 * sizeof(double));  // without a call, unlike std::copy_n
      d += 7;
      continue;
    }
    Failure failure = a.failure;
    if (rows.fault(i)) failure = {.code = Code::invalid_argument};
    status[i] = static_cast<std::uint8_t>(shown_code(failure, is_starting_));
    d = std::fill_n(d, 7, nan);
    any_failed = true;
    if (failed.size() < most_failed_) failed.push_back({i, failure});
  }
  return any_failed;
}

nb::object AnswerColumns::take_gaps() {
  return gap ? array_of(std::move(gap), {size}) : nb::none();
}

template <class AnyTree>
nb::tuple reply(const AnyTree& tree, const LookupRows& rows, AnswerColumns&& columns,
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
      reads, columns.take_gaps());
}

template nb::tuple reply(const Tree&, const LookupRows&, AnswerColumns&&, const FailureReport&,
                         const nb::object&);
template nb::tuple reply(const SharedTree&, const LookupRows&, AnswerColumns&&,
                         const FailureReport&, const nb::object&);

}  // namespace ztf
