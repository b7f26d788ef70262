// Tree: the base class of zenoh_tf.TransformTree.
//
// GIL: a single lookup or set keeps it, since releasing it would cost more than the work. If it
// waits for a frame or a mutex for more than some microseconds, it releases it. Waits for data, and
// commits of several transforms, release it. No thread waits for the GIL while it holds a lock of
// the core, so there is no deadlock between the two.
#include <chrono>
#include <cmath>

#include "bindings.hpp"

namespace ztf {

namespace {

constexpr std::pair<std::string_view, Concurrency> kConcurrency[] = {
    {"optimistic", Concurrency::optimistic},
    {"2pl", Concurrency::two_phase},
    {"giant", Concurrency::giant},
};

// Its destruction takes the wait list's mutex, whose holder may wait for a frame.
struct OwnedWaiter {
  std::optional<BlockingWaiter> waiter;
  ~OwnedWaiter() {
    const GilReleasedOnWait released;
    waiter.reset();
  }
};

constexpr std::int64_t kLeastMemory = 1 << 16;  // bytes

// Blocks until there is an answer to the query that find_names() returns, none can come, or the
// deadline has passed. Returns the note to append to a failure's message.
template <class FindNames>
[[gnu::noinline]] std::string wait(const Tree& tree, FindNames&& find_names, nb::handle target,
                                   nb::handle source, nb::handle fixed, double timeout_s,
                                   Answer& answer) {
  if (!(timeout_s >= 0)) raise_invalid("timeout_s must be 0 or more seconds", "timeout_s");
  using Clock = BlockingWaiter::Clock;
  const auto time = std::chrono::duration<double>(std::min(timeout_s, 1e9));
  const Clock::time_point deadline =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(time);
  // Python handles signals in its main thread, while that holds the GIL; so the main thread wakes
  // up regularly to check.
  const auto slice =
      is_main_thread() ? Clock::duration(std::chrono::milliseconds(100)) : Clock::duration::max();
  OwnedWaiter owned;
  BlockingWaiter& waiter =
      owned.waiter.emplace(tree.wait_list(), find_names(), text_of(target, "target_frame"),
                           text_of(source, "source_frame"),
                           fixed.is_none() ? std::string_view() : text_of(fixed, "fixed_frame"));
  for (Clock::time_point now = Clock::now();; now = Clock::now()) {
    bool done;
    {
      const GilReleased released;
      done = waiter.wait(deadline - now < slice ? deadline : now + slice);
    }
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (done) {
      answer = waiter.answer();
      return {};
    }
    if (Clock::now() >= deadline) break;
  }
  lookup_holding_gil(tree, answer, find_names);  // the failure as of the deadline
  return waited(timeout_s);
}

// The answer as a value; raises its failure.
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
  const auto query = [&] { return query_at(tree, target, source, stamp); };
  Answer a;
  if (timeout_s == 0.0) [[likely]] {
    lookup_holding_gil(tree, a, query);
    return stamped_answer(tree, a, target, source);
  }
  const std::string note = wait(tree, query, target, source, nb::none(), timeout_s, a);
  return stamped_answer(tree, a, target, source, note);
}

StampedTransform lookup_full(const Tree& tree, nb::handle target, nb::handle target_stamp,
                             nb::handle source, nb::handle source_stamp, nb::handle fixed,
                             double timeout_s) {
  const auto query = [&] {
    Query named = query_of(tree, Op::full, target, source);
    named.stamp = stamp_of(target_stamp, "target_stamp_ns");
    named.source_stamp = stamp_of(source_stamp, "source_stamp_ns");
    named.fixed = frame_of(tree, fixed, "fixed_frame").id;
    return named;
  };
  Answer a;
  std::string note;
  if (timeout_s == 0.0)
    lookup_holding_gil(tree, a, query);
  else
    note = wait(tree, query, target, source, fixed, timeout_s, a);
  if (a.failure.code == Code::ok) return stamped_answer(tree, a, target, source);
  // The lookup failed in one of its halves: source in fixed, or fixed in target.
  const bool first = a.failure.target == tree.find(text_of(fixed, "fixed_frame"));
  return stamped_answer(tree, a, first ? fixed : target, first ? source : fixed, note);
}

bool can(const Tree& tree, nb::handle target, nb::handle source, nb::handle stamp,
         double timeout_s) {
  for (const nb::handle name : {target, source}) {
    const std::string_view text = text_of(name, "frame");
    if (text.empty() || text[0] == '/') return false;
  }
  const auto query = [&] { return query_at(tree, target, source, stamp); };
  Answer a;
  if (timeout_s == 0.0)
    lookup_holding_gil(tree, a, query);
  else
    wait(tree, query, target, source, nb::none(), timeout_s, a);
  return a.failure.code == Code::ok;
}

template <Op op>
LatestTransform latest(const Tree& tree, nb::handle target, nb::handle source) {
  Answer a;
  lookup_holding_gil(tree, a, [&] { return query_of(tree, op, target, source); });
  return latest_answer(tree, a, target, source);
}

nb::list latest_all(const Tree& tree, nb::handle pairs) {
  const nb::tuple items = tuple_of(pairs);
  std::vector<Query> queries;
  std::vector<FrameRef> frames;  // of the queries: target, source
  std::vector<std::pair<nb::object, nb::object>> names;
  for (const nb::handle item : items) {
    const nb::tuple pair = nb::steal<nb::tuple>(PySequence_Tuple(item.ptr()));
    if (!pair.is_valid() || pair.size() != 2) {
      PyErr_Clear();
      raise_invalid("pairs must hold (target_frame, source_frame) tuples", "pairs");
    }
    names.emplace_back(pair[0], pair[1]);
    frames.push_back(frame_of(tree, pair[0], "target_frame"));
    frames.push_back(frame_of(tree, pair[1], "source_frame"));
    queries.push_back({Op::latest_xact, frames[frames.size() - 2].id, frames.back().id});
  }
  std::vector<Answer> answers(queries.size());
  ReadSet reads;
  // Resolves the names again after the transaction: a frame that was created or removed meanwhile
  // would be reported beside newer state of another pair.
  for (bool unchanged = false; !unchanged;) {
    {
      const GilReleasedOnWait released;
      tree.lookup_transaction(queries, answers, reads);
    }
    unchanged = true;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const FrameRef target = frame_of(tree, names[i].first, "target_frame");
      const FrameRef source = frame_of(tree, names[i].second, "source_frame");
      unchanged &= target == frames[2 * i] && source == frames[2 * i + 1];
      frames[2 * i] = target, frames[2 * i + 1] = source;
      queries[i].target = target.id, queries[i].source = source.id;
    }
  }
  nb::list out;
  for (std::size_t i = 0; i < answers.size(); ++i)
    out.append(latest_answer(tree, answers[i], names[i].first, names[i].second));
  return out;
}

std::optional<Stamp> latest_common_time(const Tree& tree, nb::handle a, nb::handle b) {
  Answer answer;
  lookup_holding_gil(tree, answer, [&] { return query_of(tree, Op::common_time, a, b); });
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
  const nb::tuple items = tuple_of(stampeds);  // keeps the names' texts alive
  std::vector<std::string_view> names;
  std::vector<Row> rows;
  names.reserve(items.size() * 2);
  rows.reserve(items.size());
  for (const nb::handle item : items) {
    if (!nb::isinstance<StampedTransform>(item))
      raise_invalid("stampeds must hold StampedTransforms", "stampeds");
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

// Runs a write without the interpreter lock.
template <class Write>
void run_released(Write write) {
  try {
    const GilReleased released;
    write();
  } catch (const Rejected& rejected) {
    raise(make_error(rejected));
  }
}

void clear(Tree& tree, bool keep_static, std::int64_t expires_ns) {
  run_released([&] { tree.clear(keep_static, expires_ns); });
}

void reset(Tree& tree, std::int64_t expires_ns) {
  run_released([&] { tree.reset(expires_ns); });
}

void remove_frame(Tree& tree, nb::handle name, bool subtree, std::int64_t expires_ns) {
  (void)frame_of(tree, name, "name");  // raises for an invalid name
  const std::string_view text = text_of(name, "name");
  run_released([&] { tree.remove_frame(text, subtree, expires_ns); });
}

std::uint32_t limit_of(std::int64_t value, std::int64_t least, std::int64_t most,
                       const char* field) {
  if (value < least || value > most)
    raise_invalid(std::string(field) + " must be from " + std::to_string(least) + " to " +
                      std::to_string(most) + ", not " + std::to_string(value),
                  field);
  return static_cast<std::uint32_t>(value);
}

Concurrency concurrency_of(std::string_view name) {
  for (const auto& [known, value] : kConcurrency)
    if (name == known) return value;
  raise_invalid("concurrency must be 'optimistic', '2pl' or 'giant', not " + quoted(name),
                "concurrency");
}

void construct(Tree* self, double cache_time_s, std::string_view concurrency,
               std::int64_t max_frames, std::int64_t max_samples_per_frame,
               std::int64_t max_name_bytes, std::int64_t max_depth, bool one_authority_per_frame,
               std::string_view time_jump, std::int64_t max_memory_bytes,
               std::uint64_t max_log_bytes) {
  Options options;
  if (!(cache_time_s > 0 && cache_time_s <= 1e9))
    raise_invalid("cache_time_s must be above 0 and at most 1e9 seconds", "cache_time_s");
  options.cache_ns = static_cast<std::uint64_t>(std::llround(cache_time_s * 1e9));
  options.concurrency = concurrency_of(concurrency);
  options.max_frames = limit_of(max_frames, 2, std::int64_t{1} << 30, "max_frames");
  options.max_samples_per_frame =
      limit_of(max_samples_per_frame, 2, std::int64_t{1} << 30, "max_samples_per_frame");
  options.max_name_bytes = limit_of(max_name_bytes, 1, 65535, "max_name_bytes");
  options.max_depth = limit_of(max_depth, 1, std::int64_t{1} << 20, "max_depth");
  options.one_authority_per_frame = one_authority_per_frame;
  if (max_memory_bytes != 0 && max_memory_bytes < kLeastMemory)
    raise_invalid("max_memory_bytes must be 0 or at least " + std::to_string(kLeastMemory) +
                      ", not " + std::to_string(max_memory_bytes),
                  "max_memory_bytes");
  options.max_memory_bytes = static_cast<std::uint64_t>(max_memory_bytes);
  if (time_jump != "reject" && time_jump != "clear")
    raise_invalid("time_jump must be 'reject' or 'clear', not " + quoted(time_jump), "time_jump");
  options.clear_on_time_jump = time_jump == "clear";
  options.max_log_bytes = max_log_bytes;
  new (self) Tree(options);
}

// "TransformTree(3 frames, cache_time_s=10.0, concurrency='optimistic')"
std::string repr_of_tree(nb::handle self) {
  const Tree& tree = nb::cast<const Tree&>(self);
  const Options& options = tree.options();
  std::size_t frames = 0;
  for (FrameId id = 1, n = tree.size(); id <= n; ++id) frames += !tree.removed(id);
  std::string_view concurrency;
  for (const auto& [name, value] : kConcurrency)
    if (value == options.concurrency) concurrency = name;
  const nb::float_ cache_time_s(static_cast<double>(options.cache_ns) / 1e9);
  return nb::cast<std::string>(self.type().attr("__name__")) + "(" + std::to_string(frames) +
         (frames == 1 ? " frame" : " frames") +
         ", cache_time_s=" + nb::cast<std::string>(nb::repr(cache_time_s)) +
         ", concurrency=" + quoted(concurrency) + ")";
}

void bind_writes(nb::class_<Tree>& tree) {
  tree.def("set_transform", &set, ZTF_DOC(Tree_set_transform), nb::arg("stamped"),
           nb::arg("authority") = "", nb::arg("static") = false)
      .def("set_transforms_xact", &set_all, ZTF_DOC(Tree_set_transforms_xact), nb::arg("stampeds"),
           nb::arg("authority") = "", nb::arg("static") = false)
      .def(
          "clear", [](Tree& t, bool keep_static) { clear(t, keep_static, kNeverExpires); },
          ZTF_DOC(Tree_clear), nb::arg("keep_static") = true)
      .def(
          "reset", [](Tree& t) { reset(t, kNeverExpires); }, ZTF_DOC(Tree_reset))
      .def(
          "remove_frame",
          [](Tree& t, nb::handle name, bool subtree) {
            remove_frame(t, name, subtree, kNeverExpires);
          },
          ZTF_DOC(Tree_remove_frame), nb::arg("name"), nb::arg("subtree") = false)
      .def("_clear", &clear, nb::arg("keep_static"), nb::arg("expires_ns"))
      .def("_reset", &reset, nb::arg("expires_ns"))
      .def("_remove_frame", &remove_frame, nb::arg("name"), nb::arg("subtree"),
           nb::arg("expires_ns"));
}

void bind_lookups(nb::class_<Tree>& tree) {
  tree.def("lookup_transform", &lookup, ZTF_DOC(Tree_lookup_transform), nb::arg("target"),
           nb::arg("source"), nb::arg("stamp_ns").none() = nb::none(), nb::arg("timeout_s") = 0.0)
      .def("lookup_transform_full", &lookup_full, ZTF_DOC(Tree_lookup_transform_full),
           nb::arg("target"), nb::arg("target_stamp_ns").none(), nb::arg("source"),
           nb::arg("source_stamp_ns").none(), nb::arg("fixed_frame"), nb::arg("timeout_s") = 0.0)
      .def("can_transform", &can, ZTF_DOC(Tree_can_transform), nb::arg("target"), nb::arg("source"),
           nb::arg("stamp_ns").none() = nb::none(), nb::arg("timeout_s") = 0.0)
      .def("lookup_latest_transform", &latest<Op::latest>, ZTF_DOC(Tree_lookup_latest_transform),
           nb::arg("target"), nb::arg("source"))
      .def("lookup_latest_transform_xact", &latest<Op::latest_xact>,
           ZTF_DOC(Tree_lookup_latest_transform_xact), nb::arg("target"), nb::arg("source"))
      .def("lookup_latest_transforms_xact", &latest_all,
           ZTF_DOC(Tree_lookup_latest_transforms_xact), nb::arg("pairs"))
      .def("latest_common_time", &latest_common_time, ZTF_DOC(Tree_latest_common_time),
           nb::arg("a"), nb::arg("b"));
}

}  // namespace

void commit(Tree& tree, const CommitRequest& request, std::span<std::uint8_t> stored,
            bool release_gil) {
  try {
    if (release_gil) {
      const GilReleased released;
      tree.commit(request, stored);
    } else {
      const GilReleasedOnWait released;
      tree.commit(request, stored);
    }
  } catch (const Rejected& rejected) {
    raise(make_error(rejected));
  }
}

void bind_tree(nb::module_& m) {
  const Options defaults;
  nb::class_<Tree> tree(m, "Tree", nb::is_weak_referenceable(), docs::Tree.text);
  tree.def("__init__", &construct, nb::arg("cache_time_s") = 10.0,
           nb::arg("concurrency") = "optimistic", nb::kw_only(),
           nb::arg("max_frames") = defaults.max_frames,
           nb::arg("max_samples_per_frame") = defaults.max_samples_per_frame,
           nb::arg("max_name_bytes") = defaults.max_name_bytes,
           nb::arg("max_depth") = defaults.max_depth,
           nb::arg("one_authority_per_frame") = defaults.one_authority_per_frame,
           nb::arg("time_jump") = "reject", nb::arg("max_memory_bytes") = 0,
           nb::arg("max_log_bytes") = 0)
      .def("__repr__", &repr_of_tree);
  bind_writes(tree);
  bind_lookups(tree);
  bind_lookup_columns(tree);
  bind_read_rows(m, tree);
  bind_commit(m, tree);
  bind_introspection(tree);
  bind_velocity(tree);
}

}  // namespace ztf
