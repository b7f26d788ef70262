// Lookups: of TransformTree, and of a tree in another process.
//
// GIL: as in tree.cpp.
#include <chrono>

#include "bindings/lookup_error.hpp"

namespace ztf {

namespace {

// Its destruction takes the wait list's mutex, whose holder may wait for a frame.
struct OwnedWaiter {
  std::optional<BlockingWaiter> waiter;
  ~OwnedWaiter() {
    const GilReleasedOnWait released;
    waiter.reset();
  }
};

// Blocks until there is an answer to the query that find_names() returns, none can come, or the
// deadline has passed. Returns how long it has waited, for the error.
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
  BlockingWaiter& waiter = owned.waiter.emplace(
      tree.state(), find_names(), text_of(target, "target_frame"), text_of(source, "source_frame"),
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

// A tree of another process: its owner waits for what is not there yet.
template <class FindNames>
std::string wait(const SharedTree& tree, FindNames&& find_names, nb::handle, nb::handle, nb::handle,
                 double timeout_s, Answer& answer) {
  if (!(timeout_s >= 0)) raise_invalid("timeout_s must be 0 or more seconds", "timeout_s");
  lookup_holding_gil(tree, answer, find_names);
  if (answer.failure.code != Code::ok) throw Unanswered{Unanswered::Reason::waiting};
  return {};
}

// The answer as a value; raises its failure.
template <class AnyTree>
StampedTransform stamped_answer(const AnyTree& tree, const Answer& a, nb::handle target,
                                nb::handle source, const LookupNote& note = {}) {
  if (a.failure.code != Code::ok) [[unlikely]]
    raise(make_error(tree, a.failure, target, source, note));
  return {nb::borrow(target), nb::borrow(source), a.stamp, a.pose, a.gap};
}

template <class AnyTree>
LatestTransform latest_answer(const AnyTree& tree, const Answer& a, nb::handle target,
                              nb::handle source) {
  return {stamped_answer(tree, a, target, source), a.newest};
}

template <class AnyTree>
Query query_at(const AnyTree& tree, nb::handle target, nb::handle source, nb::handle stamp,
               Stamp max_gap = kNoGapLimit) {
  Query query = query_of(tree, Op::latest_common, target, source);
  query.max_gap = max_gap;
  query.stamp = stamp_of(stamp, "stamp_ns");
  if (query.stamp != kNoStamp) query.op = Op::at;
  return query;
}

template <class AnyTree>
StampedTransform lookup(const AnyTree& tree, nb::handle target, nb::handle source, nb::handle stamp,
                        nb::handle timeout, nb::handle max_gap_s) {
  const double timeout_s = timeout_of(timeout);
  const Stamp max_gap = max_gap_of(max_gap_s);
  const auto query = [&] { return query_at(tree, target, source, stamp, max_gap); };
  Answer a;
  std::string waited;
  if (timeout_s == 0.0) [[likely]]
    lookup_holding_gil(tree, a, query);
  else
    waited = wait(tree, query, target, source, nb::none(), timeout_s, a);
  if (a.failure.code == Code::ok) [[likely]]
    return {nb::borrow(target), nb::borrow(source), a.stamp, a.pose, a.gap};
  return stamped_answer(tree, a, target, source,
                        {.waited = std::move(waited), .latest = stamp.is_none(), .may_wait = true});
}

template <class AnyTree>
StampedTransform lookup_full(const AnyTree& tree, nb::handle target, nb::handle target_stamp,
                             nb::handle source, nb::handle source_stamp, nb::handle fixed,
                             nb::handle timeout, nb::handle max_gap_s) {
  const double timeout_s = timeout_of(timeout);
  const Stamp max_gap = max_gap_of(max_gap_s);
  const auto query = [&] {
    Query named = query_of(tree, Op::full, target, source);
    named.max_gap = max_gap;
    named.stamp = stamp_of(target_stamp, "target_stamp_ns");
    named.source_stamp = stamp_of(source_stamp, "source_stamp_ns");
    named.fixed = frame_of(tree, fixed, "fixed_frame").id;
    return named;
  };
  Answer a;
  std::string waited;
  if (timeout_s == 0.0)
    lookup_holding_gil(tree, a, query);
  else
    waited = wait(tree, query, target, source, fixed, timeout_s, a);
  if (a.failure.code == Code::ok) return stamped_answer(tree, a, target, source);
  // The lookup failed in one of its halves: source in fixed, or fixed in target.
  const bool first = a.failure.target == tree.find(text_of(fixed, "fixed_frame"));
  const nb::handle half_stamp = first ? source_stamp : target_stamp;
  return stamped_answer(
      tree, a, first ? fixed : target, first ? source : fixed,
      {.waited = std::move(waited), .latest = half_stamp.is_none(), .may_wait = true});
}

template <class AnyTree>
bool can(const AnyTree& tree, nb::handle target, nb::handle source, nb::handle stamp,
         nb::handle timeout) {
  const double timeout_s = timeout_of(timeout);
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

template <Op op, class AnyTree>
LatestTransform latest(const AnyTree& tree, nb::handle target, nb::handle source) {
  Answer a;
  lookup_holding_gil(tree, a, [&] { return query_of(tree, op, target, source); });
  return latest_answer(tree, a, target, source);
}

template <class AnyTree>
nb::list latest_all(const AnyTree& tree, nb::handle pairs) {
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

template <class AnyTree>
std::optional<Stamp> latest_common_time(const AnyTree& tree, nb::handle a, nb::handle b) {
  Answer answer;
  lookup_holding_gil(tree, answer, [&] { return query_of(tree, Op::common_time, a, b); });
  if (answer.failure.code != Code::ok) raise(make_error(tree, answer.failure, a, b));
  return answer.stamp == kNoStamp ? std::nullopt : std::optional(answer.stamp);
}

}  // namespace

template <class T>
void bind_lookups(nb::class_<T>& tree) {
  tree.def("lookup_transform", method<&lookup<T>>, ZTF_DOC(Tree_lookup_transform),
           nb::arg("target"), nb::arg("source"), nb::arg("stamp_ns").none() = nb::none(),
           nb::arg("timeout_s") = 0.0, nb::kw_only(), nb::arg("max_gap_s").none() = nb::none())
      .def("lookup_transform_full", method<&lookup_full<T>>, ZTF_DOC(Tree_lookup_transform_full),
           nb::arg("target"), nb::arg("target_stamp_ns").none(), nb::arg("source"),
           nb::arg("source_stamp_ns").none(), nb::arg("fixed_frame"), nb::arg("timeout_s") = 0.0,
           nb::kw_only(), nb::arg("max_gap_s").none() = nb::none())
      .def("can_transform", method<&can<T>>, ZTF_DOC(Tree_can_transform), nb::arg("target"),
           nb::arg("source"), nb::arg("stamp_ns").none() = nb::none(), nb::arg("timeout_s") = 0.0)
      .def("lookup_latest_transform", method<&latest<Op::latest, T>>,
           ZTF_DOC(Tree_lookup_latest_transform), nb::arg("target"), nb::arg("source"))
      .def("lookup_latest_transform_xact", method<&latest<Op::latest_xact, T>>,
           ZTF_DOC(Tree_lookup_latest_transform_xact), nb::arg("target"), nb::arg("source"))
      .def("lookup_latest_transforms_xact", method<&latest_all<T>>,
           ZTF_DOC(Tree_lookup_latest_transforms_xact), nb::arg("pairs"))
      .def("latest_common_time", method<&latest_common_time<T>>, ZTF_DOC(Tree_latest_common_time),
           nb::arg("a"), nb::arg("b"));
}
template void bind_lookups(nb::class_<Tree>&);
template void bind_lookups(nb::class_<SharedTree>&);

}  // namespace ztf
