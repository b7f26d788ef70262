// Tree._lookup_columns and Tree._estimate_columns: many lookups in one call, numpy arrays in and
// out.
//
// GIL: arguments are read under it; the lookups run without it.
#include <algorithm>
#include <limits>

#include "bindings/messages/message_names.hpp"
#include "bindings/reads/answer_columns.hpp"

namespace ztf {

namespace {

// The number of rows that all columns agree on.
class RowCount {
 public:
  void fit(std::size_t n, const char* field) {
    if (rows_ && *rows_ != n)
      raise_invalid(std::string(field) + " has " + std::to_string(n) +
                        " rows, but the arguments before it have " + std::to_string(*rows_),
                    field);
    rows_ = n;
  }
  // 1 if every argument is a single value.
  [[nodiscard]] std::size_t value() const noexcept { return rows_.value_or(1); }

 private:
  std::optional<std::size_t> rows_;
};

// Stamps of a column, or one stamp for every row; kNoStamp only if None was given.
class StampColumn {
 public:
  StampColumn(nb::handle stamps, RowCount& rows) {
    if (stamps.is_none() || PyLong_Check(stamps.ptr())) {
      single_ = stamp_of(stamps, kField);
      return;
    }
    Column<Stamp> column;
    if (!nb::try_cast(stamps, column, false)) {
      const nb::object array = integers(stamps);
      if (nb::cast<std::size_t>(array.attr("ndim")) == 0) {
        single_ = stamp_of(array.attr("item")(), kField);
        return;
      }
      if (!nb::try_cast(array, column))
        raise_invalid("stamps_ns must be one int, None, or a sequence of ints", kField);
    }
    check(column);
    rows.fit(column.shape(0), kField);
    column_ = column;
  }
  [[nodiscard]] RowValues<Stamp> values() const noexcept {
    return column_ ? RowValues<Stamp>{column_->data()} : RowValues<Stamp>{&single_, true};
  }
  [[nodiscard]] bool has_times() const noexcept { return column_ || single_ != kNoStamp; }

 private:
  static constexpr const char* kField = "stamps_ns";

  // An int64 array of the same values.
  static nb::object integers(nb::handle stamps) {
    const nb::module_ numpy = nb::module_::import_("numpy");
    nb::object array;
    try {
      array = numpy.attr("asarray")(stamps);
    } catch (const nb::python_error& error) {
      if (!error.matches(PyExc_ValueError) && !error.matches(PyExc_TypeError)) throw;
      raise_invalid("stamps_ns must be one int, None, or a sequence of ints", kField);
    }
    const auto size = nb::cast<std::size_t>(array.attr("size"));
    const auto kind = nb::cast<std::string>(array.attr("dtype").attr("kind"));
    if (size != 0 && kind != "i" && kind != "u")
      raise_invalid("stamps_ns must be integers (nanoseconds), not " +
                        nb::cast<std::string>(array.attr("dtype").attr("name")) +
                        ": make an array with dtype=np.int64",
                    kField);
    if (size != 0 && kind == "u") stamp_of(array.attr("max")(), kField);
    return numpy.attr("ascontiguousarray")(array, numpy.attr("int64"))
        .attr("reshape")(array.attr("shape"));
  }

  // Raises for the value that means "no time" inside the tree.
  static void check(const Column<Stamp>& column) {
    const Stamp* const end = column.data() + column.shape(0);
    const Stamp* const found = std::find(column.data(), end, kNoStamp);
    if (found != end)
      raise_invalid("stamps_ns[" + std::to_string(found - column.data()) +
                        "] is -2^63; stamps are nanoseconds from -2^63 + 1 to 2^63 - 1",
                    kField);
  }

  Stamp single_ = kNoStamp;
  std::optional<Column<Stamp>> column_;
};

// The arguments of both methods as rows.
class Arguments {
 public:
  Arguments(nb::handle target_names, nb::handle source_names, nb::handle stamps_ns)
      : targets_(index_column(target_names, "targets")),
        sources_(index_column(source_names, "sources")),
        stamps_(stamps_ns, count_),
        op_(static_cast<std::uint8_t>(stamps_.has_times() ? Op::at : Op::latest_common)),
        rows(std::vector<std::string_view>(names_.texts())) {
    rows.size = count_.value();
    rows.op = {&op_, true};
    rows.target = targets_.values();
    rows.source = sources_.values();
    rows.stamp = stamps_.values();
  }
  Arguments(const Arguments&) = delete;
  Arguments& operator=(const Arguments&) = delete;

 private:
  NameColumn index_column(nb::handle given, const char* field) {
    const std::size_t known = names_.texts().size();
    NameColumn column(names_, given, field);
    for (const std::string_view name : std::span(names_.texts()).subspan(known))
      if (const auto fault = name_fault(name, field)) raise(*fault);
    if (!column.is_single()) count_.fit(column.size(), field);
    return column;
  }

  MessageNames names_;
  RowCount count_;
  const NameColumn targets_, sources_;
  const StampColumn stamps_;
  const std::uint8_t op_;

 public:
  LookupRows rows;  // made of all others
};

// (status, stamps, poses, gaps) of one lookup per row.
template <class AnyTree>
nb::tuple lookup_columns(const AnyTree& tree, nb::handle target_names, nb::handle source_names,
                         nb::handle stamps_ns, nb::handle max_gap_s) {
  const Stamp max_gap = max_gap_of(max_gap_s);
  Arguments arguments(target_names, source_names, stamps_ns);
  LookupRows& rows = arguments.rows;
  rows.max_gap = max_gap;
  const std::size_t n = rows.size;
  AnswerColumns columns(n, {.is_starting = !tree.startup().is_over(), .errors = false});
  {
    const GilReleased released;
    (void)rows.find_names(tree);
    rows.look_up_each(tree, [&](std::size_t first, std::span<const Answer> answers) {
      columns.add(rows, first, answers);
    });
  }
  if (!columns.gap) columns.gap = std::make_unique<Stamp[]>(n);
  return nb::make_tuple(array_of(std::move(columns.status), {n}),
                        array_of(std::move(columns.stamp), {n}),
                        array_of(std::move(columns.pose), {n, 7}), columns.take_gaps());
}

// (status, stamps, poses, metres, radians, level, backtests, by) of one estimate per row.
template <class AnyTree>
nb::tuple estimate_columns(const AnyTree& tree, nb::handle target_names, nb::handle source_names,
                           nb::handle stamps_ns, Stamp now, double level, Stamp max_by,
                           double radius) {
  EstimateQuery query = estimate_query(nb::none(), now, level, max_by, radius);
  Arguments arguments(target_names, source_names, stamps_ns);
  LookupRows& rows = arguments.rows;
  const std::size_t n = rows.size;
  AnswerColumns columns(n, {.is_starting = !tree.startup().is_over(), .errors = false});
  std::vector<EstimateAnswer> answers(n);
  {
    const GilReleased released;
    (void)rows.find_names(tree);
    for (std::size_t row = 0; row < n; ++row) {
      query.stamp = rows.stamp[row] == kNoStamp ? now : rows.stamp[row];
      rows.look_up_row(tree, row, [&](const Query& named) {
        query.target = named.target;
        query.source = named.source;
        tree.estimate(query, answers[row]);
      });
      const EstimateAnswer& a = answers[row];
      const Answer answer{.failure = a.failure, .pose = a.pose, .stamp = query.stamp};
      columns.add(rows, row, {&answer, 1});
    }
  }
  const auto column = [&]<class T>(T EstimateAnswer::* field, T of_failed) {
    return make_array<T>({n}, [&](T* out) {
      for (const EstimateAnswer& a : answers)
        *out++ = a.failure.code == Code::ok ? a.*field : of_failed;
    });
  };
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  return nb::make_tuple(
      array_of(std::move(columns.status), {n}), array_of(std::move(columns.stamp), {n}),
      array_of(std::move(columns.pose), {n, 7}), column(&EstimateAnswer::metres, nan),
      column(&EstimateAnswer::radians, nan), column(&EstimateAnswer::level, nan),
      column(&EstimateAnswer::backtests, {}), column(&EstimateAnswer::by, {}));
}

}  // namespace

template <class T>
void bind_lookup_columns(nb::class_<T>& tree) {
  tree.def("_estimate_columns", method<&estimate_columns<T>>, nb::arg("targets"),
           nb::arg("sources"), nb::arg("stamps_ns").none(), nb::arg("now_ns"), nb::arg("level"),
           nb::arg("max_by_ns"), nb::arg("radius_m"));
  tree.def("_lookup_columns", method<&lookup_columns<T>>, nb::arg("targets"), nb::arg("sources"),
           nb::arg("stamps_ns").none(), nb::arg("max_gap_s").none() = nb::none());
}
template void bind_lookup_columns(nb::class_<Tree>&);
template void bind_lookup_columns(nb::class_<SharedTree>&);

}  // namespace ztf
