// Many lookups at once, in columns: numpy arrays in and out.
//
// Interpreter lock: long columns release it. Names are resolved before, under
// the lock, once each.
#include <algorithm>

#include "rows.hpp"
#include "sample_block.hpp"

namespace ztf {

namespace {

constexpr std::size_t kLongColumn = 16;  // rows from which releasing the lock pays
constexpr std::size_t kPortion =
    SampleBlock::kRows;  // at a time: their answers stay in the processor's cache

// One lookup per row; a single name, stamp or None stands for every row.
nb::tuple lookup_columns(const Tree& tree, nb::handle targets, nb::handle sources,
                         nb::handle stamps) {
  std::optional<std::size_t> rows;
  const auto fit = [&](std::size_t n, const char* field) {
    if (rows && *rows != n)
      raise_invalid(
          std::string(field) + " has " + std::to_string(n) + " rows, not " + std::to_string(*rows),
          field);
    rows = n;
  };
  const auto names = [&](nb::handle value, const char* field) {
    std::vector<FrameId> ids;
    if (PyUnicode_Check(value.ptr())) {
      ids.push_back(frame_of(tree, value, field));
      return std::pair(ids, true);
    }
    const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(value.ptr()));
    if (!items.is_valid()) {
      PyErr_Clear();
      raise_invalid(std::string(field) + " must be a name or a sequence of names", field);
    }
    fit(items.size(), field);
    ids.reserve(items.size());
    // Often a name stands there many times in a row, as one object.
    const PyObject* last = nullptr;
    for (const nb::handle item : items) {
      ids.push_back(item.ptr() == last ? ids.back() : frame_of(tree, item, field));
      last = item.ptr();
    }
    return std::pair(ids, false);
  };
  const auto [target_ids, one_target] = names(targets, "targets");
  const auto [source_ids, one_source] = names(sources, "sources");
  Stamp one_stamp = kNoStamp;
  Column<Stamp> stamp_rows;
  const bool has_one_stamp = stamps.is_none() || PyLong_Check(stamps.ptr());
  if (has_one_stamp) {
    one_stamp = stamp_of(stamps, "stamps_ns");
  } else if (nb::try_cast(stamps, stamp_rows, false)) {
    fit(stamp_rows.shape(0), "stamps_ns");
  } else {
    const nb::module_ numpy = nb::module_::import_("numpy");
    nb::object array = numpy.attr("asarray")(stamps);
    if (nb::cast<std::string>(nb::str(array.attr("dtype").attr("kind"))) != "i" &&
        nb::len(array) != 0)
      raise_invalid("stamps_ns must be integers (nanoseconds)", "stamps_ns");
    array = numpy.attr("ascontiguousarray")(array, numpy.attr("int64"));
    if (!nb::try_cast(array, stamp_rows))
      raise_invalid("stamps_ns must be one int, None, or a sequence of them", "stamps_ns");
    fit(stamp_rows.shape(0), "stamps_ns");
  }
  const std::size_t n = rows.value_or(1);
  std::uint8_t* status;
  Stamp* stamp;
  double* pose;
  const nb::object out[] = {make_array<std::uint8_t>({n}, [&](std::uint8_t* d) { status = d; }),
                            make_array<Stamp>({n}, [&](Stamp* d) { stamp = d; }),
                            make_array<double>({n, 7}, [&](double* d) { pose = d; })};
  {
    nb::gil_scoped_release release;
    std::vector<Query> queries(std::min(n, kPortion));
    std::vector<Answer> answers(queries.size());
    for (std::size_t done = 0; done < n; done += queries.size()) {
      const std::size_t portion = std::min(queries.size(), n - done);
      for (std::size_t i = 0; i < portion; ++i) {
        const std::size_t row = done + i;
        const Stamp time = has_one_stamp ? one_stamp : stamp_rows(row);
        queries[i] = {time == kNoStamp ? Op::latest_common : Op::at,
                      target_ids[one_target ? 0 : row], source_ids[one_source ? 0 : row], time};
      }
      tree.lookup_batch({queries.data(), portion}, {answers.data(), portion});
      for (std::size_t i = 0; i < portion; ++i) {
        const Answer& a = answers[i];
        const Pose& answered = a.failure.code == Code::ok ? a.pose : Pose{};
        *status++ = static_cast<std::uint8_t>(a.failure.code);
        *stamp++ = a.stamp;
        pose = std::copy_n(&answered.x, 7, pose);
      }
    }
  }
  return nb::make_tuple(out[0], out[1], out[2]);
}

// What was read: names and their versions.
nb::object versions_of(const Tree& tree, const ReadRows& rows,
                       const std::vector<ReadVersion>& read_set) {
  nb::list read_names;
  for (const ReadVersion& r : read_set) {
    const std::string_view name = tree.name(r.frame);
    read_names.append(nb::str(name.data(), name.size()));
  }
  // What does not exist was read too: it must still not be there.
  std::size_t unknown = 0;
  for (std::size_t i = 0; i < rows.ids.size(); ++i)
    if (rows.ids[i] == 0 && !rows.bad_name[i]) {
      read_names.append(rows.held[i]);
      ++unknown;
    }
  return nb::make_tuple(read_names,
                        make_array<Version>({read_set.size() + unknown}, [&](Version* d) {
                          for (const ReadVersion& r : read_set) *d++ = r.version;
                          std::fill(d, d + unknown, Version{0});
                        }));
}

nb::tuple read_rows(const Tree& tree, nb::handle names, const Column<std::uint8_t>& op,
                    const Column<std::uint32_t>& target, const Column<std::uint32_t>& source,
                    const Column<Stamp>& stamp, const std::optional<Column<std::uint32_t>>& fixed,
                    const std::optional<Column<Stamp>>& source_stamp, bool atomic, bool versions) {
  ReadRows rows(tree, names, op, target, source, stamp, fixed, source_stamp);
  std::vector<Query>& queries = rows.queries;
  const std::size_t n = queries.size();
  if (versions)  // what is read must be one state
    for (Query& q : queries)
      if (q.op == Op::latest) q.op = Op::latest_xact;
  std::vector<Answer> answers(n);
  std::vector<ReadVersion> read_set;
  const auto run = [&] {
    ReadSet reads;
    if (atomic) {
      do tree.lookup_transaction(queries, answers, reads);
      while (!rows.names_stand(tree));
      if (versions) read_set.assign(reads.begin(), reads.end());
    } else if (!versions) {
      tree.lookup_batch(queries, answers);
    } else {
      for (std::size_t i = 0; i < n; ++i) {
        tree.lookup_transaction({&queries[i], 1}, {&answers[i], 1}, reads);
        read_set.insert(read_set.end(), reads.begin(), reads.end());
      }
    }
  };
  if (n >= kLongColumn) {
    nb::gil_scoped_release release;
    run();
  } else {
    run();
  }
  return reply(tree, rows, answers, {}, versions ? versions_of(tree, rows, read_set) : nb::none());
}

}  // namespace

nb::object status_column(const std::vector<Answer>& answers) {
  return make_array<std::uint8_t>({answers.size()}, [&](std::uint8_t* d) {
    for (const Answer& a : answers) *d++ = static_cast<std::uint8_t>(a.failure.code);
  });
}
nb::object stamp_column(const std::vector<Answer>& answers, Stamp Answer::* member) {
  return make_array<Stamp>({answers.size()}, [&](Stamp* d) {
    for (const Answer& a : answers) *d++ = a.*member;
  });
}
nb::object pose_column(const std::vector<Answer>& answers) {
  return make_array<double>({answers.size(), 7}, [&](double* d) {
    for (const Answer& a : answers) {
      const double* values = &a.pose.x;
      for (int i = 0; i < 7; ++i) *d++ = values[i];
    }
  });
}

std::vector<nb::object> names_of(nb::handle names, std::vector<std::string_view>& texts,
                                 const char* field) {
  const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(names.ptr()));
  if (!items.is_valid()) throw nb::python_error();
  std::vector<nb::object> held;
  for (const nb::handle item : items) {
    texts.push_back(text_of(item, field));
    held.push_back(nb::borrow(item));
  }
  return held;
}

std::uint32_t checked(std::uint32_t index, std::size_t names, const char* field) {
  if (index >= names)
    raise_invalid(std::string(field) + ": row " + std::to_string(index) + " of " +
                      std::to_string(names) + " names",
                  field);
  return index;
}

ReadRows::ReadRows(const Tree& tree, nb::handle name_list, const Column<std::uint8_t>& op,
                   const Column<std::uint32_t>& target, const Column<std::uint32_t>& source,
                   const Column<Stamp>& stamp, const std::optional<Column<std::uint32_t>>& fixed,
                   const std::optional<Column<Stamp>>& source_stamp)
    : held(names_of(name_list, texts, "names")), bad_name(held.size()) {
  for (std::size_t i = 0; i < held.size(); ++i) {
    try {
      ids.push_back(frame_of(tree, held[i], "frame"));
    } catch (nb::python_error&) {
      bad_name[i] = true;
      ids.push_back(0);
    }
  }
  const std::size_t n = op.shape(0);
  fit(target, n, "target");
  fit(source, n, "source");
  fit(stamp, n, "stamp_ns");
  if (fixed) fit(*fixed, n, "fixed");
  if (source_stamp) fit(*source_stamp, n, "source_stamp_ns");
  queries.resize(n);
  names.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    Query& q = queries[i];
    if (op(i) >= kOps) raise_invalid("op: no operation " + std::to_string(op(i)), "op");
    q.op = static_cast<Op>(op(i));
    names[i] = {checked(target(i), ids.size(), "target"), checked(source(i), ids.size(), "source"),
                0};
    q.stamp = stamp(i);
    if (q.op == Op::at && q.stamp == kNoStamp)
      raise_invalid("stamp_ns is out of range", "stamp_ns");
    if (q.op == Op::full) {
      if (!fixed || !source_stamp)
        raise_invalid("a full lookup needs fixed and source_stamp_ns", "fixed");
      names[i].fixed = checked((*fixed)(i), ids.size(), "fixed");
      q.source_stamp = (*source_stamp)(i);
    }
  }
  use_ids();
}

void ReadRows::use_ids() {
  for (std::size_t i = 0; i < queries.size(); ++i) {
    queries[i].target = ids[names[i].target];
    queries[i].source = ids[names[i].source];
    if (queries[i].op == Op::full) queries[i].fixed = ids[names[i].fixed];
  }
}

bool ReadRows::names_stand(const Tree& tree) {
  bool stand = true;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const FrameId id = bad_name[i] ? 0 : tree.find(texts[i]);
    stand &= id == ids[i];
    ids[i] = id;
  }
  if (!stand) use_ids();
  return stand;
}

bool ReadRows::has_bad_name(std::size_t row) const {
  const auto [target, source, fixed] = names[row];
  return bad_name[target] || bad_name[source] || (queries[row].op == Op::full && bad_name[fixed]);
}

nb::object ReadRows::name_error(const Tree& tree, std::size_t row) const {
  const auto [target, source, fixed] = names[row];
  try {
    (void)frame_of(tree, held[target], "target_frame");
    (void)frame_of(tree, held[source], "source_frame");
    (void)frame_of(tree, held[fixed], "fixed_frame");
  } catch (nb::python_error& error) {
    return nb::borrow(error.value());
  }
  return nb::object();
}

nb::tuple reply(const Tree& tree, const ReadRows& rows, std::vector<Answer>& answers,
                const std::vector<std::string>& notes, const nb::object& reads) {
  nb::list failures;
  for (std::size_t i = 0; i < answers.size(); ++i) {
    Answer& a = answers[i];
    if (a.failure.code == Code::ok) [[likely]]
      continue;
    nb::object error;
    if (rows.has_bad_name(i)) {
      a.failure.code = Code::invalid_argument;
      error = rows.name_error(tree, i);
    } else {
      auto [target, source, fixed] = rows.names[i];
      if (rows.queries[i].op ==
          Op::full)  // the leg that failed: source in fixed, or fixed in target
        (a.failure.target == rows.queries[i].fixed ? target : source) = fixed;
      error = make_error(tree, a.failure, rows.held[target], rows.held[source],
                         notes.empty() ? std::string() : notes[i]);
    }
    failures.append(nb::make_tuple(i, error));
    a.pose = Pose{};
  }
  return nb::make_tuple(status_column(answers), stamp_column(answers, &Answer::stamp),
                        stamp_column(answers, &Answer::newest), pose_column(answers), failures,
                        reads);
}

void bind_read(nb::module_& m, nb::class_<Tree>& tree) {
  m.attr("OP_AT") = static_cast<int>(Op::at);
  m.attr("OP_COMMON") = static_cast<int>(Op::latest_common);
  m.attr("OP_LATEST") = static_cast<int>(Op::latest);
  m.attr("OP_LATEST_XACT") = static_cast<int>(Op::latest_xact);
  m.attr("OP_COMMON_TIME") = static_cast<int>(Op::common_time);
  m.attr("OP_FULL") = static_cast<int>(Op::full);
  m.attr("NO_STAMP") = kNoStamp;

  tree.def("lookup_columns", &lookup_columns, nb::arg("targets"), nb::arg("sources"),
           nb::arg("stamps_ns").none())
      .def("read_rows", &read_rows, nb::arg("names"), nb::arg("op"), nb::arg("target"),
           nb::arg("source"), nb::arg("stamp_ns"), nb::arg("fixed").none() = nb::none(),
           nb::arg("source_stamp_ns").none() = nb::none(), nb::kw_only(), nb::arg("atomic") = false,
           nb::arg("versions") = false);
}

}  // namespace ztf
