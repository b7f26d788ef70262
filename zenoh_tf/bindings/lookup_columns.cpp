// Tree._lookup_columns: many lookups in one call, numpy arrays in and out.
//
// GIL: names are resolved under it, once each; the lookups run without it.
#include <algorithm>
#include <limits>

#include "bindings.hpp"
#include "sample_block.hpp"

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
class FrameColumn {
 public:
  FrameColumn(const Tree& tree, nb::handle names, const char* field, RowCount& rows)
      : single_(PyUnicode_Check(names.ptr())) {
    if (single_) {
      ids_.push_back(frame_of(tree, names, field));
      return;
    }
    const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(names.ptr()));
    if (!items.is_valid()) {
      PyErr_Clear();
      raise_invalid(std::string(field) + " must be a name or a sequence of names", field);
    }
    rows.fit(items.size(), field);
    ids_.reserve(items.size());
    // Often one str object is repeated many times in a row.
    const PyObject* last = nullptr;
    for (const nb::handle item : items) {
      ids_.push_back(item.ptr() == last ? ids_.back() : frame_of(tree, item, field));
      last = item.ptr();
    }
  }
  FrameId operator[](std::size_t row) const noexcept { return ids_[single_ ? 0 : row]; }

 private:
  const bool single_;
  std::vector<FrameId> ids_;
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
                        nb::cast<std::string>(array.attr("dtype").attr("name")),
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

void look_up(const Tree& tree, const FrameColumn& targets, const FrameColumn& sources,
             const StampColumn& stamps, std::size_t n, std::uint8_t* status, Stamp* stamp,
             double* pose) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<Query> queries(std::min(n, kPortion));
  std::vector<Answer> answers(queries.size());
  for (std::size_t done = 0; done < n; done += queries.size()) {
    const std::size_t portion = std::min(queries.size(), n - done);
    for (std::size_t i = 0; i < portion; ++i) {
      const Stamp time = stamps[done + i];
      queries[i] = {time == kNoStamp ? Op::latest_common : Op::at, targets[done + i],
                    sources[done + i], time};
    }
    tree.lookup_batch({queries.data(), portion}, {answers.data(), portion});
    for (std::size_t i = 0; i < portion; ++i) {
      const Answer& a = answers[i];
      const bool ok = a.failure.code == Code::ok;
      *status++ = static_cast<std::uint8_t>(a.failure.code);
      *stamp++ = a.stamp;
      pose = ok ? std::copy_n(&a.pose.x, 7, pose) : std::fill_n(pose, 7, nan);
    }
  }
}

// (status, stamps, poses) of one lookup per row.
nb::tuple lookup_columns(const Tree& tree, nb::handle target_names, nb::handle source_names,
                         nb::handle stamps_ns) {
  RowCount rows;
  const FrameColumn targets(tree, target_names, "targets", rows);
  const FrameColumn sources(tree, source_names, "sources", rows);
  const StampColumn stamps(stamps_ns, rows);
  const std::size_t n = rows.value();
  std::uint8_t* status;
  Stamp* stamp;
  double* pose;
  const nb::object out[] = {make_array<std::uint8_t>({n}, [&](std::uint8_t* d) { status = d; }),
                            make_array<Stamp>({n}, [&](Stamp* d) { stamp = d; }),
                            make_array<double>({n, 7}, [&](double* d) { pose = d; })};
  {
    const GilReleased released;
    look_up(tree, targets, sources, stamps, n, status, stamp, pose);
  }
  return nb::make_tuple(out[0], out[1], out[2]);
}

}  // namespace

void bind_lookup_columns(nb::class_<Tree>& tree) {
  tree.def("_lookup_columns", &lookup_columns, nb::arg("targets"), nb::arg("sources"),
           nb::arg("stamps_ns").none());
}

}  // namespace ztf
