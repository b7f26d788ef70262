// The tree, as zenoh_tf.TransformTree builds on it.
//
// Interpreter lock: a single lookup or set keeps it, since giving it away and
// taking it back would cost more than the work; commits of several rows and
// long columns release it. No lock of the core is ever held while waiting for
// the interpreter lock, so the two cannot block each other.
#include <chrono>
#include <cmath>

#include "bindings.hpp"

namespace ztf {

namespace {

using Clock = CommitSignal::Clock;

constexpr std::size_t kLongColumn = 16;  // rows from which releasing the lock pays

Clock::time_point deadline_of(double timeout_s) {
  if (!(timeout_s >= 0)) raise_invalid("timeout_s must not be negative", "timeout_s");
  return Clock::now() + std::chrono::nanoseconds(static_cast<std::int64_t>(std::min(timeout_s, 1e9) * 1e9));
}

// Waits, so that Ctrl-C is heard.
void wait(const Tree& tree, std::uint64_t seen, Clock::time_point deadline) {
  const auto slice = std::min(deadline, Clock::now() + std::chrono::milliseconds(100));
  {
    nb::gil_scoped_release release;
    tree.signal().wait(seen, slice);
  }
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
}

// Asks until there is an answer, none can come, or the time is over.
template <class MakeQuery>
Answer ask(const Tree& tree, MakeQuery&& make_query, double timeout_s) {
  Answer answer;
  if (timeout_s == 0.0) [[likely]] {
    tree.lookup(make_query(), answer);
    return answer;
  }
  const Clock::time_point deadline = deadline_of(timeout_s);
  for (;;) {
    const std::uint64_t seen = tree.signal().epoch();
    tree.lookup(make_query(), answer);
    if (answer.failure.code == Code::ok || !tree.may_come(answer.failure)) return answer;
    if (Clock::now() >= deadline) return answer;
    wait(tree, seen, deadline);
  }
}

std::string waited(double timeout_s) {
  return timeout_s > 0 ? " (waited up to " + std::to_string(timeout_s) + " s)" : "";
}

StampedTransform stamped_answer(const Tree& tree, const Answer& a, nb::handle target,
                                nb::handle source, double timeout_s) {
  if (a.failure.code != Code::ok) [[unlikely]]
    raise(make_error(tree, a.failure, target, source, waited(timeout_s)));
  return {nb::borrow(target), nb::borrow(source), a.stamp, a.pose};
}

LatestTransform latest_answer(const Tree& tree, const Answer& a, nb::handle target,
                              nb::handle source) {
  return {stamped_answer(tree, a, target, source, 0.0), a.newest};
}

Query query_of(const Tree& tree, Op op, nb::handle target, nb::handle source) {
  return {op, frame_of(tree, target, "target_frame"), frame_of(tree, source, "source_frame")};
}

Query query_at(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp) {
  Query query = query_of(tree, Op::common, target, source);
  query.stamp = stamp_of(stamp, "stamp_ns");
  if (query.stamp != kNoStamp) query.op = Op::at;
  return query;
}

StampedTransform lookup(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp,
                        double timeout_s) {
  const Answer a = ask(tree, [&] { return query_at(tree, target, source, stamp); }, timeout_s);
  return stamped_answer(tree, a, target, source, timeout_s);
}

StampedTransform lookup_full(const Tree& tree, nb::handle target, nb::handle target_stamp,
                             nb::handle source, nb::handle source_stamp, nb::handle fixed,
                             double timeout_s) {
  const auto make_query = [&] {
    Query query = query_of(tree, Op::full, target, source);
    query.stamp = stamp_of(target_stamp, "target_stamp_ns");
    query.source_stamp = stamp_of(source_stamp, "source_stamp_ns");
    query.fixed = frame_of(tree, fixed, "fixed_frame");
    return query;
  };
  const Answer a = ask(tree, make_query, timeout_s);
  if (a.failure.code != Code::ok) {
    // The leg that failed: source in fixed, or fixed in target.
    const bool first = a.failure.target == tree.find(text_of(fixed, "fixed_frame"));
    raise(make_error(tree, a.failure, first ? fixed : target, first ? source : fixed,
                     waited(timeout_s)));
  }
  return stamped_answer(tree, a, target, source, timeout_s);
}

bool can(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp,
         double timeout_s) {
  for (const nb::handle name : {target, source}) {
    const std::string_view text = text_of(name, "frame");
    if (text.empty() || text[0] == '/') return false;
  }
  const Answer a = ask(tree, [&] { return query_at(tree, target, source, stamp); }, timeout_s);
  return a.failure.code == Code::ok;
}

template <Op op>
LatestTransform latest(const Tree& tree, nb::handle target, nb::handle source) {
  Answer a;
  tree.lookup(query_of(tree, op, target, source), a);
  return latest_answer(tree, a, target, source);
}

nb::list latest_all(const Tree& tree, nb::handle pairs) {
  const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(pairs.ptr()));
  if (!items.is_valid()) throw nb::python_error();
  std::vector<Query> queries;
  std::vector<std::pair<nb::object, nb::object>> names;
  for (const nb::handle item : items) {
    const nb::tuple pair = nb::steal<nb::tuple>(PySequence_Tuple(item.ptr()));
    if (!pair.is_valid() || pair.size() != 2) {
      PyErr_Clear();
      raise_invalid("pairs must hold (target_frame, source_frame) tuples", "pairs");
    }
    names.emplace_back(pair[0], pair[1]);
    queries.push_back(query_of(tree, Op::latest_xact, pair[0], pair[1]));
  }
  std::vector<Answer> answers(queries.size());
  ReadSet reads;
  tree.lookup_all(queries, answers, reads);
  nb::list out;
  for (std::size_t i = 0; i < answers.size(); ++i)
    out.append(latest_answer(tree, answers[i], names[i].first, names[i].second));
  return out;
}

std::optional<Stamp> latest_common_time(const Tree& tree, nb::handle a, nb::handle b) {
  Answer answer;
  tree.lookup(query_of(tree, Op::common_time, a, b), answer);
  if (answer.failure.code != Code::ok) raise(make_error(tree, answer.failure, a, b));
  return answer.stamp == kNoStamp ? std::nullopt : std::optional(answer.stamp);
}

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

void commit(Tree& tree, const CommitRequest& request, std::span<std::uint8_t> stored, bool release) {
  try {
    if (release) {
      nb::gil_scoped_release released;
      tree.commit(request, stored);
    } else {
      tree.commit(request, stored);
    }
  } catch (const Refused& refused) {
    raise(make_error(refused));
  }
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

bool set(Tree& tree, const StampedTransform& s, std::string_view authority, bool is_static) {
  const std::string_view names[] = {text_of(s.parent_frame, "parent_frame"),
                                    text_of(s.child_frame, "child_frame")};
  const Row row{0, 1, s.stamp, s.pose};
  std::uint8_t stored = 0;
  commit(tree, {.names = names, .rows = {&row, 1}, .authority = authority, .is_static = is_static,
                .drop_old = true}, {&stored, 1}, false);
  return stored != 0;
}

void set_all(Tree& tree, nb::handle stampeds, std::string_view authority, bool is_static) {
  // A tuple of our own: nobody can change it, so the names' texts stay.
  const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(stampeds.ptr()));
  if (!items.is_valid()) throw nb::python_error();
  std::vector<std::string_view> names;
  std::vector<Row> rows;
  names.reserve(items.size() * 2);
  rows.reserve(items.size());
  for (const nb::handle item : items) {
    if (!nb::isinstance<StampedTransform>(item))
      raise_invalid("stampeds must hold StampedTransform", "stampeds");
    const auto& s = nb::cast<const StampedTransform&>(item);
    const auto at = static_cast<std::uint32_t>(names.size());
    names.push_back(text_of(s.parent_frame, "parent_frame"));
    names.push_back(text_of(s.child_frame, "child_frame"));
    rows.push_back({at, at + 1, s.stamp, s.pose});
  }
  std::vector<std::uint8_t> stored(rows.size());
  commit(tree, {.names = names, .rows = rows, .authority = authority, .is_static = is_static},
         stored, true);
}

FrameId known(const Tree& tree, nb::handle name) {
  const FrameId id = frame_of(tree, name, "frame");
  if (id == 0) {
    nb::dict facts;
    facts["frame"] = name;
    raise(make_error(Code::lookup, "frame '" + std::string(text_of(name, "frame")) + "' does not exist",
                     facts));
  }
  return id;
}

nb::object name_or_none(const Tree& tree, FrameId id) {
  if (id == 0) return nb::none();
  const std::string_view name = tree.name(id);
  return nb::str(name.data(), name.size());
}

nb::list frames(const Tree& tree) {
  nb::list out;
  for (FrameId id = 1, n = tree.size(); id <= n; ++id) out.append(name_or_none(tree, id));
  return out;
}

nb::dict frame_record(const Tree& tree, nb::handle name) {
  const FrameId id = known(tree, name);
  const FrameInfo info = tree.info(id);
  const FrameCounters& counters = tree.counters(id);
  const auto count = [](const std::atomic<std::uint32_t>& c) { return c.load(std::memory_order_relaxed); };
  const bool has_data = info.parent != 0;
  const std::string_view authority = tree.authority(info.authority);
  nb::dict out;
  out["name"] = name;
  out["parent"] = name_or_none(tree, info.parent);
  out["authority"] = nb::str(authority.data(), authority.size());
  out["static"] = has_data && info.is_static;
  out["samples"] = has_data ? (info.is_static ? 1 : info.samples) : 0;
  out["oldest_stamp_ns"] = has_data ? nb::object(nb::int_(info.is_static ? info.newest : info.oldest)) : nb::none();
  out["newest_stamp_ns"] = has_data ? nb::object(nb::int_(info.newest)) : nb::none();
  out["version"] = info.version;
  out["rewritten"] = count(counters.rewritten);
  out["dropped"] = count(counters.dropped);
  out["evicted"] = count(counters.evicted);
  out["reparented"] = count(counters.reparented);
  out["switched"] = count(counters.switched);
  out["authority_changes"] = count(counters.authority_changes);
  return out;
}

nb::list chain(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp) {
  Query query = query_of(tree, Op::at, target, source);
  query.stamp = stamp_of(stamp, "stamp_ns");
  std::vector<FrameId> ids;
  const Failure failure = tree.chain(query, ids);
  if (failure.code != Code::ok) raise(make_error(tree, failure, target, source));
  nb::list out;
  for (const FrameId id : ids) out.append(name_or_none(tree, id));
  return out;
}

nb::dict stats(const Tree& tree) {
  std::uint64_t rewritten = 0, dropped = 0, evicted = 0, samples = 0, statics = 0;
  for (FrameId id = 1, n = tree.size(); id <= n; ++id) {
    const FrameInfo info = tree.info(id);
    const FrameCounters& counters = tree.counters(id);
    if (info.parent != 0 && info.is_static)
      ++statics;
    else if (info.parent != 0)
      samples += info.samples;
    rewritten += counters.rewritten.load(std::memory_order_relaxed);
    dropped += counters.dropped.load(std::memory_order_relaxed);
    evicted += counters.evicted.load(std::memory_order_relaxed);
  }
  nb::dict out;
  out["frames"] = tree.size();
  out["static_links"] = statics;
  out["samples"] = samples;
  out["commits"] = tree.signal().epoch();
  out["rewritten"] = rewritten;
  out["dropped"] = dropped;
  out["evicted"] = evicted;
  return out;
}

std::uint32_t limit_of(std::int64_t value, std::int64_t least, std::int64_t most, const char* field) {
  if (value < least || value > most)
    raise_invalid(std::string(field) + " must be from " + std::to_string(least) + " to " +
                      std::to_string(most), field);
  return static_cast<std::uint32_t>(value);
}

void construct(Tree* self, double cache_time_s, std::string_view concurrency, std::int64_t max_frames,
               std::int64_t max_samples_per_frame, std::int64_t max_name_bytes,
               std::int64_t max_depth, bool one_authority_per_frame) {
  Options options;
  if (!(cache_time_s > 0 && cache_time_s <= 1e9))
    raise_invalid("cache_time_s must be above 0 and at most 1e9 seconds", "cache_time_s");
  options.cache_ns = static_cast<std::uint64_t>(std::llround(cache_time_s * 1e9));
  if (concurrency == "optimistic")
    options.concurrency = Concurrency::optimistic;
  else if (concurrency == "2pl")
    options.concurrency = Concurrency::two_phase;
  else if (concurrency == "giant")
    options.concurrency = Concurrency::giant;
  else
    raise_invalid("concurrency must be 'optimistic', '2pl' or 'giant'", "concurrency");
  options.max_frames = limit_of(max_frames, 2, std::int64_t{1} << 30, "max_frames");
  options.max_samples_per_frame =
      limit_of(max_samples_per_frame, 2, std::int64_t{1} << 30, "max_samples_per_frame");
  options.max_name_bytes = limit_of(max_name_bytes, 1, 65535, "max_name_bytes");
  options.max_depth = limit_of(max_depth, 1, std::int64_t{1} << 20, "max_depth");
  options.one_authority_per_frame = one_authority_per_frame;
  new (self) Tree(options);
}

std::uint64_t wait_commit(const Tree& tree, std::uint64_t seen, double timeout_s) {
  const Clock::time_point deadline = deadline_of(timeout_s);
  while (tree.signal().epoch() == seen && Clock::now() < deadline) wait(tree, seen, deadline);
  return tree.signal().epoch();
}

}  // namespace

void bind_tree(nb::module_& m) {
  m.attr("OP_AT") = static_cast<int>(Op::at);
  m.attr("OP_COMMON") = static_cast<int>(Op::common);
  m.attr("OP_LATEST") = static_cast<int>(Op::latest);
  m.attr("OP_LATEST_XACT") = static_cast<int>(Op::latest_xact);
  m.attr("OP_COMMON_TIME") = static_cast<int>(Op::common_time);
  m.attr("OP_FULL") = static_cast<int>(Op::full);
  m.attr("NO_STAMP") = kNoStamp;

  const Options defaults;
  nb::class_<Tree>(m, "Tree", nb::is_weak_referenceable())
      .def("__init__", &construct, nb::arg("cache_time_s") = 10.0,
           nb::arg("concurrency") = "optimistic", nb::kw_only(),
           nb::arg("max_frames") = defaults.max_frames,
           nb::arg("max_samples_per_frame") = defaults.max_samples_per_frame,
           nb::arg("max_name_bytes") = defaults.max_name_bytes,
           nb::arg("max_depth") = defaults.max_depth,
           nb::arg("one_authority_per_frame") = defaults.one_authority_per_frame)
      .def("set_transform", &set, nb::arg("stamped"), nb::arg("authority") = "",
           nb::arg("static") = false)
      .def("set_transforms_xact", &set_all, nb::arg("stampeds"), nb::arg("authority") = "",
           nb::arg("static") = false)
      .def("lookup_transform", &lookup, nb::arg("target"), nb::arg("source"),
           nb::arg("stamp_ns").none() = nb::none(), nb::arg("timeout_s") = 0.0)
      .def("lookup_transform_full", &lookup_full, nb::arg("target"),
           nb::arg("target_stamp_ns").none(), nb::arg("source"), nb::arg("source_stamp_ns").none(),
           nb::arg("fixed_frame"), nb::arg("timeout_s") = 0.0)
      .def("can_transform", &can, nb::arg("target"), nb::arg("source"),
           nb::arg("stamp_ns").none() = nb::none(), nb::arg("timeout_s") = 0.0)
      .def("lookup_latest_transform", &latest<Op::latest>, nb::arg("target"), nb::arg("source"))
      .def("lookup_latest_transform_xact", &latest<Op::latest_xact>, nb::arg("target"),
           nb::arg("source"))
      .def("lookup_latest_transforms_xact", &latest_all, nb::arg("pairs"))
      .def("latest_common_time", &latest_common_time, nb::arg("a"), nb::arg("b"))
      .def("lookup_columns", &lookup_columns, nb::arg("targets"), nb::arg("sources"),
           nb::arg("stamps_ns").none())
      .def("read_rows", &read_rows, nb::arg("names"), nb::arg("op"), nb::arg("target"),
           nb::arg("source"), nb::arg("stamp_ns"), nb::arg("fixed").none() = nb::none(),
           nb::arg("source_stamp_ns").none() = nb::none(), nb::kw_only(), nb::arg("atomic") = false,
           nb::arg("versions") = false)
      .def("commit_rows", &commit_rows, nb::arg("names"), nb::arg("parent"), nb::arg("child"),
           nb::arg("stamp_ns"), nb::arg("pose"), nb::kw_only(), nb::arg("authority") = "",
           nb::arg("static") = false, nb::arg("drop_old") = false,
           nb::arg("read_names") = nb::make_tuple(), nb::arg("read_versions").none() = nb::none())
      .def("frames", &frames)
      .def("frame_record", &frame_record, nb::arg("name"))
      .def("parent",
           [](const Tree& tree, nb::handle frame, nb::handle stamp) {
             return name_or_none(tree, tree.parent(known(tree, frame), stamp_of(stamp, "stamp_ns")));
           },
           nb::arg("frame"), nb::arg("stamp_ns").none() = nb::none())
      .def("chain", &chain, nb::arg("target"), nb::arg("source"),
           nb::arg("stamp_ns").none() = nb::none())
      .def("clear", &Tree::clear, nb::arg("keep_static") = true,
           nb::call_guard<nb::gil_scoped_release>())
      .def("stats", &stats)
      .def("commit_epoch", [](const Tree& tree) { return tree.signal().epoch(); })
      .def("wait_commit", &wait_commit, nb::arg("seen_epoch"), nb::arg("timeout_s"));
}

}  // namespace ztf
