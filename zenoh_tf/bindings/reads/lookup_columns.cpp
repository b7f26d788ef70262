// Tree._lookup_columns: many lookups in one call, numpy arrays in and out.
//
// GIL: names are resolved under it, once each; the lookups run without it.
#include <algorithm>
#include <limits>

#include "bindings/bindings.hpp"
#include "reads/sample_block.hpp"

namespace ztf {

namespace {

// Rows looked up at a time, so that their answers stay in the cache until they are copied out.
constexpr std::size_t kPortion = SampleBlock::kRows;

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

// Frames of a column of names, or of one name that stands for every row.
template <class AnyTree>
class FrameColumn {
 public:
  FrameColumn(const AnyTree& tree, nb::handle names, const char* field, RowCount& rows)
      : tree_(tree), field_(field), single_(PyUnicode_Check(names.ptr())) {
    if (single_) {
      items_ = nb::make_tuple(names);
      frames_.push_back(frame_of(tree, names, field));
      return;
    }
    items_ = nb::steal<nb::tuple>(PySequence_Tuple(names.ptr()));
    if (!items_.is_valid()) {
      PyErr_Clear();
      raise_invalid(std::string(field) + " must be a name or a sequence of names", field);
    }
    rows.fit(items_.size(), field);
    frames_.reserve(items_.size());
    // Often one str object is repeated many times in a row.
    const PyObject* last = nullptr;
    for (const nb::handle item : items_) {
      frames_.push_back(item.ptr() == last ? frames_.back() : frame_of(tree, item, field));
      last = item.ptr();
    }
  }
  FrameId operator[](std::size_t row) const noexcept { return frames_[index(row)].id; }
  // Returns whether the names of these rows still have the ids that were found. Needs no GIL.
  [[nodiscard]] bool are_current(std::size_t begin, std::size_t end) const noexcept {
    if (single_) return tree_.is_current(frames_[0]);
    const auto rows = std::span(frames_).subspan(begin, end - begin);
    return std::ranges::all_of(rows, [&](FrameRef frame) { return tree_.is_current(frame); });
  }
  [[nodiscard]] FrameId find_again(std::size_t row) const {
    return frame_of(tree_, items_[index(row)], field_).id;
  }

 private:
  [[nodiscard]] std::size_t index(std::size_t row) const noexcept { return single_ ? 0 : row; }

  const AnyTree& tree_;
  const char* const field_;
  const bool single_;
  nb::tuple items_;
  std::vector<FrameRef> frames_;
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
  Stamp operator[](std::size_t row) const noexcept { return column_ ? (*column_)(row) : single_; }

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

// The columns of the reply.
struct Output {
  std::uint8_t* status;
  Stamp* stamp;
  double* pose;
  Stamp* gap;        // of lookups only
  bool is_starting;  // the tree's server

  void store(std::size_t row, const Answer& a) const {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    stamp[row] = a.stamp;
    if (a.failure.code == Code::ok) [[likely]] {
      status[row] = 0;
      std::copy_n(&a.pose.x, 7, pose + 7 * row);
    } else {
      status[row] = static_cast<std::uint8_t>(shown_code(a.failure, is_starting));
      std::fill_n(pose + 7 * row, 7, nan);
    }
  }
};

Query query_of_row(FrameId target, FrameId source, Stamp time, Stamp max_gap) {
  return {.op = time == kNoStamp ? Op::latest_common : Op::at,
          .target = target,
          .source = source,
          .stamp = time,
          .max_gap = max_gap};
}

// Returns the rows whose names have lost their ids meanwhile.
template <class AnyTree>
std::vector<std::size_t> look_up(const AnyTree& tree, const FrameColumn<AnyTree>& targets,
                                 const FrameColumn<AnyTree>& sources, const StampColumn& stamps,
                                 Stamp max_gap, std::size_t n, const Output& out) {
  std::vector<std::size_t> lost;
  std::vector<Query> queries(std::min(n, kPortion));
  std::vector<Answer> answers(queries.size());
  for (std::size_t done = 0; done < n; done += queries.size()) {
    const std::size_t portion = std::min(queries.size(), n - done);
    for (std::size_t i = 0; i < portion; ++i)
      queries[i] = query_of_row(targets[done + i], sources[done + i], stamps[done + i], max_gap);
    tree.lookup_batch({queries.data(), portion}, {answers.data(), portion});
    for (std::size_t i = 0; i < portion; ++i) {
      out.store(done + i, answers[i]);
      out.gap[done + i] = answers[i].gap;
    }
    const auto are_current = [&](std::size_t begin, std::size_t end) {
      return targets.are_current(begin, end) && sources.are_current(begin, end);
    };
    if (are_current(done, done + portion)) [[likely]]
      continue;
    for (std::size_t row = done; row < done + portion; ++row)
      if (!are_current(row, row + 1)) lost.push_back(row);
  }
  return lost;
}

// (status, stamps, poses, gaps) of one lookup per row.
template <class AnyTree>
nb::tuple lookup_columns(const AnyTree& tree, nb::handle target_names, nb::handle source_names,
                         nb::handle stamps_ns, nb::handle max_gap_s) {
  const Stamp max_gap = max_gap_of(max_gap_s);
  RowCount rows;
  const FrameColumn<AnyTree> targets(tree, target_names, "targets", rows);
  const FrameColumn<AnyTree> sources(tree, source_names, "sources", rows);
  const StampColumn stamps(stamps_ns, rows);
  const std::size_t n = rows.value();
  Output out;
  out.is_starting = !tree.startup().is_over();
  const nb::object columns[] = {
      make_array<std::uint8_t>({n}, [&](std::uint8_t* d) { out.status = d; }),
      make_array<Stamp>({n}, [&](Stamp* d) { out.stamp = d; }),
      make_array<double>({n, 7}, [&](double* d) { out.pose = d; }),
      make_array<Stamp>({n}, [&](Stamp* d) { out.gap = d; })};
  std::vector<std::size_t> lost;
  {
    const GilReleased released;
    lost = look_up(tree, targets, sources, stamps, max_gap, n, out);
  }
  for (const std::size_t row : lost) {
    Answer answer;
    lookup_holding_gil(tree, answer, [&] {
      return query_of_row(targets.find_again(row), sources.find_again(row), stamps[row], max_gap);
    });
    out.store(row, answer);
    out.gap[row] = answer.gap;
  }
  return nb::make_tuple(columns[0], columns[1], columns[2], columns[3]);
}

// The columns of estimates.
struct EstimateOutput {
  Output answers;
  double *metres, *radians, *level;
  std::int64_t *backtests, *by;

  void store(std::size_t row, const EstimateQuery& query, const EstimateAnswer& a) const {
    const bool ok = a.failure.code == Code::ok;
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    answers.store(row, {.failure = a.failure, .pose = a.pose, .stamp = query.stamp});
    metres[row] = ok ? a.metres : nan;
    radians[row] = ok ? a.radians : nan;
    level[row] = ok ? a.level : nan;
    backtests[row] = ok ? a.backtests : 0;
    by[row] = ok ? a.by : 0;
  }
};

// (status, stamps, poses, metres, radians, level, backtests, by) of one estimate per row.
template <class AnyTree>
nb::tuple estimate_columns(const AnyTree& tree, nb::handle target_names, nb::handle source_names,
                           nb::handle stamps_ns, Stamp now, double level, Stamp max_by,
                           double radius) {
  EstimateQuery query = estimate_query(nb::none(), now, level, max_by, radius);
  RowCount rows;
  const FrameColumn<AnyTree> targets(tree, target_names, "targets", rows);
  const FrameColumn<AnyTree> sources(tree, source_names, "sources", rows);
  const StampColumn stamps(stamps_ns, rows);
  const std::size_t n = rows.value();
  EstimateOutput out;
  out.answers.is_starting = !tree.startup().is_over();
  const auto doubles = [&](double*& column) {
    return make_array<double>({n}, [&](double* d) { column = d; });
  };
  const auto integers = [&](std::int64_t*& column) {
    return make_array<std::int64_t>({n}, [&](std::int64_t* d) { column = d; });
  };
  const nb::tuple columns = nb::make_tuple(
      make_array<std::uint8_t>({n}, [&](std::uint8_t* d) { out.answers.status = d; }),
      make_array<Stamp>({n}, [&](Stamp* d) { out.answers.stamp = d; }),
      make_array<double>({n, 7}, [&](double* d) { out.answers.pose = d; }), doubles(out.metres),
      doubles(out.radians), doubles(out.level), integers(out.backtests), integers(out.by));
  const auto estimate = [&](std::size_t row) {
    query.stamp = stamps[row] == kNoStamp ? now : stamps[row];
    EstimateAnswer answer;
    tree.estimate(query, answer);
    out.store(row, query, answer);
  };
  std::vector<std::size_t> lost;
  {
    const GilReleased released;
    for (std::size_t row = 0; row < n; ++row) {
      query.target = targets[row];
      query.source = sources[row];
      estimate(row);
      if (!targets.are_current(row, row + 1) || !sources.are_current(row, row + 1))
        lost.push_back(row);
    }
  }
  for (const std::size_t row : lost)
    (void)tree.read_names([&] {
      query.target = targets.find_again(row);
      query.source = sources.find_again(row);
      const GilReleasedOnWait released;
      estimate(row);
      return true;
    });
  return columns;
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
