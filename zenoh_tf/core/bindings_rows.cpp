// Many lookups or transforms at once, in columns: numpy arrays in and out.
//
// Interpreter lock: long columns and commits release it. Names are resolved
// before, under the lock, once each.
#include <algorithm>
#include <unordered_map>

#include "bindings.hpp"

namespace ztf {

namespace {

constexpr std::size_t kLongColumn = 16;  // rows from which releasing the lock pays

nb::object status_column(const std::vector<Answer>& answers) {
  return make_array<std::uint8_t>({answers.size()}, [&](std::uint8_t* d) {
    for (const Answer& a : answers) *d++ = static_cast<std::uint8_t>(a.failure.code);
  });
}
template <class Member>
nb::object stamp_column(const std::vector<Answer>& answers, Member member) {
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

// One lookup per row; a single name, stamp or None stands for every row.
nb::tuple lookup_columns(const Tree& tree, nb::handle targets, nb::handle sources,
                         nb::handle stamps) {
  std::optional<std::size_t> rows;
  const auto fit = [&](std::size_t n, const char* field) {
    if (rows && *rows != n)
      raise_invalid(std::string(field) + " has " + std::to_string(n) + " rows, not " +
                        std::to_string(*rows), field);
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
    for (const nb::handle item : items) ids.push_back(frame_of(tree, item, field));
    return std::pair(ids, false);
  };
  const auto [target_ids, one_target] = names(targets, "targets");
  const auto [source_ids, one_source] = names(sources, "sources");
  Stamp one_stamp = kNoStamp;
  Column<Stamp> stamp_rows;
  const bool has_one_stamp = stamps.is_none() || PyLong_Check(stamps.ptr());
  if (has_one_stamp) {
    one_stamp = stamp_of(stamps, "stamps_ns");
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
  std::vector<Answer> answers(n);
  {
    nb::gil_scoped_release release;
    for (std::size_t i = 0; i < n; ++i) {
      const Stamp stamp = has_one_stamp ? one_stamp : stamp_rows(i);
      const Query query{stamp == kNoStamp ? Op::common : Op::at, target_ids[one_target ? 0 : i],
                        source_ids[one_source ? 0 : i], stamp};
      tree.lookup(query, answers[i]);
      if (answers[i].failure.code != Code::ok) answers[i].pose = Pose{};
    }
  }
  return nb::make_tuple(status_column(answers), stamp_column(answers, &Answer::stamp),
                        pose_column(answers));
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
                      std::to_string(names) + " names", field);
  return index;
}

template <class T>
void fit(const Column<T>& column, std::size_t n, const char* field) {
  if (column.shape(0) != n)
    raise_invalid(std::string(field) + " has " + std::to_string(column.shape(0)) + " rows, not " +
                      std::to_string(n), field);
}

nb::tuple read_rows(const Tree& tree, nb::handle names, const Column<std::uint8_t>& op,
                    const Column<std::uint32_t>& target, const Column<std::uint32_t>& source,
                    const Column<Stamp>& stamp, std::optional<Column<std::uint32_t>> fixed,
                    std::optional<Column<Stamp>> source_stamp, bool atomic, bool versions) {
  std::vector<std::string_view> texts;
  const std::vector<nb::object> held = names_of(names, texts, "names");
  std::vector<FrameId> ids;
  std::vector<nb::object> bad_name(held.size());  // an error, where a name can be no frame's
  for (std::size_t i = 0; i < held.size(); ++i) {
    try {
      ids.push_back(frame_of(tree, held[i], "frame"));
    } catch (nb::python_error& error) {
      bad_name[i] = nb::borrow(error.value());
      ids.push_back(0);
    }
  }
  const std::size_t n = op.shape(0);
  fit(target, n, "target");
  fit(source, n, "source");
  fit(stamp, n, "stamp_ns");
  if (fixed) fit(*fixed, n, "fixed");
  if (source_stamp) fit(*source_stamp, n, "source_stamp_ns");
  std::vector<Query> queries(n);
  for (std::size_t i = 0; i < n; ++i) {
    Query& q = queries[i];
    if (op(i) >= kOps) raise_invalid("op: no operation " + std::to_string(op(i)), "op");
    q.op = static_cast<Op>(op(i));
    q.target = ids[checked(target(i), ids.size(), "target")];
    q.source = ids[checked(source(i), ids.size(), "source")];
    q.stamp = stamp(i);
    if (q.op == Op::at && q.stamp == kNoStamp) raise_invalid("stamp_ns is out of range", "stamp_ns");
    if (q.op == Op::full) {
      if (!fixed || !source_stamp) raise_invalid("a full lookup needs fixed and source_stamp_ns", "fixed");
      q.fixed = ids[checked((*fixed)(i), ids.size(), "fixed")];
      q.source_stamp = (*source_stamp)(i);
    }
    if (versions && q.op == Op::latest) q.op = Op::latest_xact;  // what is read must be one state
  }
  std::vector<Answer> answers(n);
  std::vector<ReadVersion> read_set;
  const auto run = [&] {
    ReadSet reads;
    if (atomic) {
      tree.lookup_all(queries, answers, reads);
      if (versions) read_set.assign(reads.begin(), reads.end());
    } else {
      for (std::size_t i = 0; i < n; ++i) {
        if (!versions) {
          tree.lookup(queries[i], answers[i]);
          continue;
        }
        tree.lookup_all({&queries[i], 1}, {&answers[i], 1}, reads);
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
  nb::list failures;
  for (std::size_t i = 0; i < n; ++i) {
    Answer& a = answers[i];
    if (a.failure.code == Code::ok) [[likely]]
      continue;
    std::uint32_t first = target(i), second = source(i);
    nb::object error;
    if (queries[i].op == Op::full) {
      const std::uint32_t via = (*fixed)(i);
      if (bad_name[via].is_valid()) error = bad_name[via];
      if (a.failure.target == queries[i].fixed)
        first = via;
      else
        second = via;
    }
    for (const std::uint32_t name : {source(i), target(i)})
      if (bad_name[name].is_valid()) error = bad_name[name];
    if (!error.is_valid())
      error = make_error(tree, a.failure, held[first], held[second]);
    else
      a.failure.code = Code::invalid_argument;
    failures.append(nb::make_tuple(i, error));
    a.pose = Pose{};
  }
  nb::object read = nb::none();
  if (versions) {
    nb::list read_names;
    for (const ReadVersion& r : read_set) {
      const std::string_view name = tree.name(r.frame);
      read_names.append(nb::str(name.data(), name.size()));
    }
    // What does not exist was read too: it must still not be there.
    std::size_t unknown = 0;
    for (std::size_t i = 0; i < ids.size(); ++i)
      if (ids[i] == 0 && !bad_name[i].is_valid()) {
        read_names.append(held[i]);
        ++unknown;
      }
    read = nb::make_tuple(read_names, make_array<Version>({read_set.size() + unknown}, [&](Version* d) {
                            for (const ReadVersion& r : read_set) *d++ = r.version;
                            std::fill(d, d + unknown, Version{0});
                          }));
  }
  return nb::make_tuple(status_column(answers), stamp_column(answers, &Answer::stamp),
                        stamp_column(answers, &Answer::newest), pose_column(answers), failures, read);
}

// Transforms as the columns of a commit; each name once, in order of appearance.
nb::tuple columns_of(nb::handle stampeds) {
  const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(stampeds.ptr()));
  if (!items.is_valid()) throw nb::python_error();
  std::vector<const StampedTransform*> rows;
  rows.reserve(items.size());
  for (const nb::handle item : items) {
    if (!nb::isinstance<StampedTransform>(item))
      raise_invalid("stampeds must hold StampedTransform", "stampeds");
    rows.push_back(&nb::cast<const StampedTransform&>(item));
  }
  const std::size_t n = rows.size();
  nb::list names;
  std::unordered_map<std::string_view, std::uint32_t> known;
  const auto row_of = [&](nb::handle name) {
    const auto [at, is_new] =
        known.try_emplace(text_of(name, "frame"), static_cast<std::uint32_t>(known.size()));
    if (is_new) names.append(name);
    return at->second;
  };
  std::vector<std::uint32_t> parent(n), child(n);
  for (std::size_t i = 0; i < n; ++i) {
    parent[i] = row_of(rows[i]->parent_frame);
    child[i] = row_of(rows[i]->child_frame);
  }
  const auto copied = [n](const std::vector<std::uint32_t>& column) {
    return make_array<std::uint32_t>({n}, [&](std::uint32_t* d) {
      std::copy(column.begin(), column.end(), d);
    });
  };
  return nb::make_tuple(
      names, copied(parent), copied(child),
      make_array<Stamp>({n}, [&](Stamp* d) {
        for (const StampedTransform* row : rows) *d++ = row->stamp;
      }),
      make_array<double>({n, 7}, [&](double* d) {
        for (const StampedTransform* row : rows) d = std::copy_n(&row->pose.x, 7, d);
      }));
}

nb::object commit_rows(Tree& tree, nb::handle names, const Column<std::uint32_t>& parent,
                       const Column<std::uint32_t>& child, const Column<Stamp>& stamp,
                       const PoseColumn& pose, std::string_view authority, bool is_static,
                       bool drop_old, nb::handle read_names,
                       std::optional<Column<Version>> read_versions) {
  std::vector<std::string_view> texts, read_texts;
  const std::vector<nb::object> held = names_of(names, texts, "names");
  const std::vector<nb::object> read_held = names_of(read_names, read_texts, "read_names");
  const std::size_t n = parent.shape(0);
  fit(child, n, "child");
  fit(stamp, n, "stamp_ns");
  if (pose.shape(0) != n) raise_invalid("pose has not as many rows as parent", "pose");
  if ((read_versions ? read_versions->shape(0) : 0) != read_texts.size())
    raise_invalid("read_versions has not as many rows as read_names", "read_versions");
  std::vector<Row> rows(n);
  for (std::size_t i = 0; i < n; ++i) {
    rows[i] = {checked(parent(i), texts.size(), "parent"), checked(child(i), texts.size(), "child"),
               stamp(i), {pose(i, 0), pose(i, 1), pose(i, 2), pose(i, 3), pose(i, 4), pose(i, 5),
                          pose(i, 6)}};
  }
  std::vector<std::uint8_t> stored(n);
  CommitRequest request{.names = texts, .rows = rows, .authority = authority,
                        .is_static = is_static, .drop_old = drop_old, .read_names = read_texts};
  if (read_versions) request.read_versions = {read_versions->data(), read_texts.size()};
  commit(tree, request, stored, true);
  return make_array<std::uint8_t>({n}, [&](std::uint8_t* d) { std::copy(stored.begin(), stored.end(), d); });
}

}  // namespace

void bind_rows(nb::module_& m, nb::class_<Tree>& tree) {
  m.def("columns_of", &columns_of, nb::arg("stampeds"));
  m.attr("OP_AT") = static_cast<int>(Op::at);
  m.attr("OP_COMMON") = static_cast<int>(Op::common);
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
           nb::arg("versions") = false)
      .def("commit_rows", &commit_rows, nb::arg("names"), nb::arg("parent"), nb::arg("child"),
           nb::arg("stamp_ns"), nb::arg("pose"), nb::kw_only(), nb::arg("authority") = "",
           nb::arg("static") = false, nb::arg("drop_old") = false,
           nb::arg("read_names") = nb::make_tuple(), nb::arg("read_versions").none() = nb::none());
}

}  // namespace ztf
