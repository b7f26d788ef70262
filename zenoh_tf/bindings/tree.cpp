// The tree, as zenoh_tf.TransformTree builds on it.
//
// Interpreter lock: a single lookup or set keeps it, since giving it away and
// taking it back would cost more than the work; whatever waits, and commits of
// several transforms, release it. No lock of the core is ever held while
// waiting for the interpreter lock, so the two cannot block each other.
#include <chrono>
#include <cmath>

#include "bindings.hpp"

namespace ztf {

namespace {

// Sleeps until there is an answer, none can come, or the time is over. Returns
// what the message of a failure then adds.
[[gnu::noinline]] std::string wait(const Tree& tree, const Query& query, nb::handle target,
                                   nb::handle source, nb::handle fixed, double timeout_s,
                                   Answer& answer) {
  if (!(timeout_s >= 0)) raise_invalid("timeout_s must not be negative", "timeout_s");
  using Clock = BlockingWaiter::Clock;
  const auto time = std::chrono::duration<double>(std::min(timeout_s, 1e9));
  const Clock::time_point deadline =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(time);
  // Signals are heard by Python's main thread only, and only while it holds the
  // interpreter lock: that thread wakes up to look.
  const auto slice =
      is_main_thread() ? Clock::duration(std::chrono::milliseconds(100)) : Clock::duration::max();
  BlockingWaiter waiter(tree.wait_list(), query, text_of(target, "target_frame"),
                        text_of(source, "source_frame"),
                        fixed.is_none() ? std::string_view() : text_of(fixed, "fixed_frame"));
  for (Clock::time_point now = Clock::now();; now = Clock::now()) {
    bool over;
    {
      const Unlocked unlocked;
      over = waiter.wait(deadline - now < slice ? deadline : now + slice);
    }
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (over) {
      answer = waiter.answer();
      return {};
    }
    if (Clock::now() >= deadline) break;
  }
  tree.lookup(waiter.query(), answer);  // as of the deadline
  return waited(timeout_s);
}

// What an answer is made of, or raised as: what was asked, by name.
StampedTransform stamped_answer(const Tree& tree, const Answer& a, nb::handle target,
                                nb::handle source, const std::string& note = {}) {
  if (a.failure.code != Code::ok) [[unlikely]]
    raise(make_error(tree, a.failure, target, source, note));
  return {nb::borrow(target), nb::borrow(source), a.stamp, a.pose};
}

LatestTransform latest_answer(const Tree& tree, const Answer& a, nb::handle target,
                              nb::handle source) {
  return {stamped_answer(tree, a, target, source), a.newest};
}

Query query_at(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp) {
  Query query = query_of(tree, Op::latest_common, target, source);
  query.stamp = stamp_of(stamp, "stamp_ns");
  if (query.stamp != kNoStamp) query.op = Op::at;
  return query;
}

StampedTransform lookup(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp,
                        double timeout_s) {
  const Query query = query_at(tree, target, source, stamp);
  Answer a;
  if (timeout_s == 0.0) [[likely]] {
    tree.lookup(query, a);
    return stamped_answer(tree, a, target, source);
  }
  const std::string note = wait(tree, query, target, source, nb::none(), timeout_s, a);
  return stamped_answer(tree, a, target, source, note);
}

StampedTransform lookup_full(const Tree& tree, nb::handle target, nb::handle target_stamp,
                             nb::handle source, nb::handle source_stamp, nb::handle fixed,
                             double timeout_s) {
  Query query = query_of(tree, Op::full, target, source);
  query.stamp = stamp_of(target_stamp, "target_stamp_ns");
  query.source_stamp = stamp_of(source_stamp, "source_stamp_ns");
  query.fixed = frame_of(tree, fixed, "fixed_frame");
  Answer a;
  std::string note;
  if (timeout_s == 0.0)
    tree.lookup(query, a);
  else
    note = wait(tree, query, target, source, fixed, timeout_s, a);
  if (a.failure.code == Code::ok) return stamped_answer(tree, a, target, source);
  // The leg that failed: source in fixed, or fixed in target.
  const bool first = a.failure.target == tree.find(text_of(fixed, "fixed_frame"));
  return stamped_answer(tree, a, first ? fixed : target, first ? source : fixed, note);
}

bool can(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp,
         double timeout_s) {
  for (const nb::handle name : {target, source}) {
    const std::string_view text = text_of(name, "frame");
    if (text.empty() || text[0] == '/') return false;
  }
  const Query query = query_at(tree, target, source, stamp);
  Answer a;
  if (timeout_s == 0.0)
    tree.lookup(query, a);
  else
    wait(tree, query, target, source, nb::none(), timeout_s, a);
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
  tree.lookup_transaction(queries, answers, reads);
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

bool set(Tree& tree, const StampedTransform& s, std::string_view authority, bool is_static) {
  const std::string_view names[] = {text_of(s.parent_frame, "parent_frame"),
                                    text_of(s.child_frame, "child_frame")};
  const Row row{0, 1, s.stamp, s.pose};
  std::uint8_t stored = 0;
  commit(tree,
         {.names = names,
          .rows = {&row, 1},
          .authority = authority,
          .is_static = is_static,
          .drop_old = true},
         {&stored, 1}, false);
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

void remove_frame(Tree& tree, nb::handle name, bool subtree) {
  (void)frame_of(tree, name, "name");  // refuses what can be no frame's name
  const std::string_view text = text_of(name, "name");
  try {
    nb::gil_scoped_release release;
    tree.remove_frame(text, subtree);
  } catch (const Rejected& refused) {
    raise(make_error(refused));
  }
}

constexpr const char* kResetDoc =
    R"(reset() -> None

Drop every frame at one instant: all samples, static links and names.

The tree is then as new, apart from its counters and authorities. Readers see
it before or after, never in part. A name that was ever used keeps counting
against ``max_frames``; to keep the names use ``clear(keep_static=False)``.
Works for any number of frames, in time proportional to it.)";

std::uint32_t limit_of(std::int64_t value, std::int64_t least, std::int64_t most,
                       const char* field) {
  if (value < least || value > most)
    raise_invalid(std::string(field) + " must be from " + std::to_string(least) + " to " +
                      std::to_string(most),
                  field);
  return static_cast<std::uint32_t>(value);
}

void construct(Tree* self, double cache_time_s, std::string_view concurrency,
               std::int64_t max_frames, std::int64_t max_samples_per_frame,
               std::int64_t max_name_bytes, std::int64_t max_depth, bool one_authority_per_frame,
               std::string_view time_jump) {
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
  if (time_jump != "reject" && time_jump != "clear")
    raise_invalid("time_jump must be 'reject' or 'clear'", "time_jump");
  options.clear_on_time_jump = time_jump == "clear";
  new (self) Tree(options);
}

}  // namespace

void bind_tree(nb::module_& m) {
  const Options defaults;
  nb::class_<Tree> tree(m, "Tree", nb::is_weak_referenceable());
  tree.def("__init__", &construct, nb::arg("cache_time_s") = 10.0,
           nb::arg("concurrency") = "optimistic", nb::kw_only(),
           nb::arg("max_frames") = defaults.max_frames,
           nb::arg("max_samples_per_frame") = defaults.max_samples_per_frame,
           nb::arg("max_name_bytes") = defaults.max_name_bytes,
           nb::arg("max_depth") = defaults.max_depth,
           nb::arg("one_authority_per_frame") = defaults.one_authority_per_frame,
           nb::arg("time_jump") = "reject")
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
      .def("clear", &Tree::clear, nb::arg("keep_static") = true,
           nb::call_guard<nb::gil_scoped_release>())
      .def("reset", &Tree::reset, nb::call_guard<nb::gil_scoped_release>(), kResetDoc)
      .def("remove_frame", &remove_frame, nb::arg("name"), nb::arg("subtree") = false);
  bind_read(m, tree);
  bind_commit(m, tree);
  bind_introspection(tree);
  bind_velocity(tree);
}

}  // namespace ztf
