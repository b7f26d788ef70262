// Tree._read_rows: lookups of every kind as columns, for the server.
//
// GIL: many rows release it. Names are resolved before, under it.
#include "read_rows.hpp"

#include <algorithm>
#include <limits>

namespace ztf {

namespace {

constexpr std::size_t kReleaseFrom = 16;  // rows from which releasing the GIL pays

// The read set: names of frames and their versions. A frame that does not exist has version 0:
// a transaction conflicts if it is created.
nb::object versions_of(const Tree& tree, const ReadRows& rows,
                       const std::vector<ReadVersion>& read_set) {
  nb::list read_names;
  for (const ReadVersion& r : read_set) {
    const std::string_view name = tree.name(r.frame);
    read_names.append(nb::str(name.data(), name.size()));
  }
  std::size_t unknown = 0;
  for (std::size_t i = 0; i < rows.ids.size(); ++i)
    if (rows.ids[i] == 0 && !rows.invalid_name[i]) {
      read_names.append(rows.name_objects[i]);
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
  if (versions)  // one instant per row, so that its versions belong together
    for (Query& q : queries)
      if (q.op == Op::latest) q.op = Op::latest_xact;
  std::vector<Answer> answers(n);
  std::vector<ReadVersion> read_set;
  const auto run = [&] {
    ReadSet reads;
    if (atomic) {
      do tree.lookup_transaction(queries, answers, reads);
      while (!rows.refresh_ids(tree));
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
  if (n >= kReleaseFrom) {
    const GilReleased released;
    run();
  } else {
    const GilReleasedOnWait released;
    run();
  }
  return reply(tree, rows, answers, {}, versions ? versions_of(tree, rows, read_set) : nb::none());
}

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
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  return make_array<double>({answers.size(), 7}, [&](double* d) {
    for (const Answer& a : answers)
      d = a.failure.code == Code::ok ? std::copy_n(&a.pose.x, 7, d) : std::fill_n(d, 7, nan);
  });
}

}  // namespace

std::vector<nb::object> names_of(nb::handle names, std::vector<std::string_view>& texts,
                                 const char* field) {
  std::vector<nb::object> objects;
  for (const nb::handle item : tuple_of(names)) {
    texts.push_back(text_of(item, field));
    objects.push_back(nb::borrow(item));
  }
  return objects;
}

std::uint32_t checked(std::uint32_t index, std::size_t names, const char* field) {
  if (index >= names)
    raise_invalid(std::string(field) + " has the index " + std::to_string(index) +
                      ", but there are " + std::to_string(names) + " names",
                  field);
  return index;
}

ReadRows::ReadRows(const Tree& tree, nb::handle name_list, const Column<std::uint8_t>& op,
                   const Column<std::uint32_t>& target, const Column<std::uint32_t>& source,
                   const Column<Stamp>& stamp, const std::optional<Column<std::uint32_t>>& fixed,
                   const std::optional<Column<Stamp>>& source_stamp)
    : name_objects(names_of(name_list, texts, "names")), invalid_name(name_objects.size()) {
  for (std::size_t i = 0; i < name_objects.size(); ++i) {
    try {
      ids.push_back(frame_of(tree, name_objects[i], "frame"));
    } catch (nb::python_error&) {
      invalid_name[i] = true;
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
    if (op(i) >= kOps)
      raise_invalid("op must be below " + std::to_string(kOps) + ", not " + std::to_string(op(i)),
                    "op");
    q.op = static_cast<Op>(op(i));
    names[i] = {checked(target(i), ids.size(), "target"), checked(source(i), ids.size(), "source"),
                0};
    q.stamp = stamp(i);
    if (q.op == Op::at && q.stamp == kNoStamp)
      raise_invalid("stamp_ns is -2^63; stamps are nanoseconds from -2^63 + 1 to 2^63 - 1",
                    "stamp_ns");
    if (q.op == Op::full) {
      if (!fixed || !source_stamp)
        raise_invalid("a full lookup needs fixed and source_stamp_ns", "fixed");
      names[i].fixed = checked((*fixed)(i), ids.size(), "fixed");
      q.source_stamp = (*source_stamp)(i);
    }
  }
  set_query_ids();
}

void ReadRows::set_query_ids() {
  for (std::size_t i = 0; i < queries.size(); ++i) {
    queries[i].target = ids[names[i].target];
    queries[i].source = ids[names[i].source];
    if (queries[i].op == Op::full) queries[i].fixed = ids[names[i].fixed];
  }
}

bool ReadRows::refresh_ids(const Tree& tree) {
  bool unchanged = true;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const FrameId id = invalid_name[i] ? 0 : tree.find(texts[i]);
    unchanged &= id == ids[i];
    ids[i] = id;
  }
  if (!unchanged) set_query_ids();
  return unchanged;
}

bool ReadRows::has_invalid_name(std::size_t row) const {
  const auto [target, source, fixed] = names[row];
  return invalid_name[target] || invalid_name[source] ||
         (queries[row].op == Op::full && invalid_name[fixed]);
}

nb::object ReadRows::name_error(const Tree& tree, std::size_t row) const {
  const auto [target, source, fixed] = names[row];
  try {
    (void)frame_of(tree, name_objects[target], "target_frame");
    (void)frame_of(tree, name_objects[source], "source_frame");
    (void)frame_of(tree, name_objects[fixed], "fixed_frame");
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
    if (rows.has_invalid_name(i)) {
      a.failure.code = Code::invalid_argument;
      error = rows.name_error(tree, i);
    } else {
      auto [target, source, fixed] = rows.names[i];
      // A full lookup failed in one of its halves: source in fixed, or fixed in target.
      if (rows.queries[i].op == Op::full)
        (a.failure.target == rows.queries[i].fixed ? target : source) = fixed;
      error = make_error(tree, a.failure, rows.name_objects[target], rows.name_objects[source],
                         notes.empty() ? std::string() : notes[i]);
    }
    failures.append(nb::make_tuple(i, error));
  }
  return nb::make_tuple(status_column(answers), stamp_column(answers, &Answer::stamp),
                        stamp_column(answers, &Answer::newest), pose_column(answers), failures,
                        reads);
}

void bind_read_rows(nb::module_& m, nb::class_<Tree>& tree) {
  m.attr("OP_AT") = static_cast<int>(Op::at);
  m.attr("OP_COMMON") = static_cast<int>(Op::latest_common);
  m.attr("OP_LATEST") = static_cast<int>(Op::latest);
  m.attr("OP_LATEST_XACT") = static_cast<int>(Op::latest_xact);
  m.attr("OP_COMMON_TIME") = static_cast<int>(Op::common_time);
  m.attr("OP_FULL") = static_cast<int>(Op::full);
  m.attr("NO_STAMP") = kNoStamp;

  tree.def("_read_rows", &read_rows, nb::arg("names"), nb::arg("op"), nb::arg("target"),
           nb::arg("source"), nb::arg("stamp_ns"), nb::arg("fixed").none() = nb::none(),
           nb::arg("source_stamp_ns").none() = nb::none(), nb::kw_only(), nb::arg("atomic") = false,
           nb::arg("versions") = false);
}

}  // namespace ztf
