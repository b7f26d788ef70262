// Lookups: of TransformTree, and of a tree in another process.
//
// GIL: as in tree.cpp.
#include <chrono>

#include "bindings/bindings.hpp"
#include "by_name/rows.hpp"

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

// Blocks until there is an answer, none can come, or the deadline has passed. Returns how long it
// has waited, for the error.
[[gnu::noinline]] std::string wait(const Tree& tree, NamedQuery& query, double timeout_s,
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
  BlockingWaiter& waiter = owned.waiter.emplace(tree.state(), query, query.target_name,
                                                query.source_name, query.fixed_name);
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
  const GilReleasedOnWait released;
  lookup(tree, query, answer);  // the failure as of the deadline
  return waited_for(timeout_s);
}

// A tree of another process: its owner waits for what is not there yet.
std::string wait(const SharedTree& tree, NamedQuery& query, double timeout_s, Answer& answer) {
  if (!(timeout_s >= 0)) raise_invalid("timeout_s must be 0 or more seconds", "timeout_s");
  const GilReleasedOnWait released;
  lookup(tree, query, answer);
  if (answer.failure.code != Code::ok) throw Unanswered{Unanswered::Reason::waiting};
  return {};
}

// Sets the answer. Returns how long it has waited, for an error.
template <class AnyTree>
ZTF_ALWAYS_INLINE std::string answer_query(const AnyTree& tree, NamedQuery& query, double timeout_s,
                                           Answer& answer) {
  if (timeout_s != 0.0) [[unlikely]]
    return wait(tree, query, timeout_s, answer);
  const GilReleasedOnWait released;
  lookup(tree, query, answer);
  return {};
}

template <class AnyTree>
[[noreturn, gnu::noinline]] void raise_failure(const AnyTree& tree, const NamedQuery& query,
                                               const Answer& answer, std::string waited = {}) {
  raise(lookup_error(tree, answer.failure, query, {.waited = std::move(waited), .may_wait = true}));
}

// Answers the query; raises its failure.
template <class AnyTree>
ZTF_ALWAYS_INLINE Answer answered(const AnyTree& tree, NamedQuery query, double timeout_s = 0) {
  Answer answer;
  std::string waited = answer_query(tree, query, timeout_s, answer);
  if (answer.failure.code != Code::ok) [[unlikely]]
    raise_failure(tree, query, answer, std::move(waited));
  return answer;
}

ZTF_ALWAYS_INLINE NamedQuery query_at(nb::handle target, nb::handle source, nb::handle stamp) {
  NamedQuery query = query_of(Op::latest_common, target, source);
  query.stamp = stamp_of(stamp, "stamp_ns");
  if (query.stamp != kNoStamp) query.op = Op::at;
  return query;
}

template <class AnyTree>
StampedTransform lookup_at(const AnyTree& tree, nb::handle target, nb::handle source,
                           nb::handle stamp, nb::handle timeout, nb::handle max_gap_s) {
  const double timeout_s = timeout_of(timeout);
  const Stamp max_gap = max_gap_of(max_gap_s);
  NamedQuery query = query_at(target, source, stamp);
  query.max_gap = max_gap;
  const Answer a = answered(tree, query, timeout_s);
  return {nb::borrow(target), nb::borrow(source), a.stamp, a.pose, a.gap};
}

template <class AnyTree>
StampedTransform lookup_full(const AnyTree& tree, nb::handle target, nb::handle target_stamp,
                             nb::handle source, nb::handle source_stamp, nb::handle fixed,
                             nb::handle timeout, nb::handle max_gap_s) {
  const double timeout_s = timeout_of(timeout);
  const Stamp max_gap = max_gap_of(max_gap_s);
  NamedQuery query = query_of(Op::full, target, source);
  query.max_gap = max_gap;
  query.stamp = stamp_of(target_stamp, "target_stamp_ns");
  query.source_stamp = stamp_of(source_stamp, "source_stamp_ns");
  query.fixed_name = frame_name_of(fixed, "fixed_frame");
  const Answer a = answered(tree, query, timeout_s);
  return {nb::borrow(target), nb::borrow(source), a.stamp, a.pose, a.gap};
}

template <class AnyTree>
bool can(const AnyTree& tree, nb::handle target, nb::handle source, nb::handle stamp,
         nb::handle timeout) {
  const double timeout_s = timeout_of(timeout);
  for (const nb::handle name : {target, source})
    if (!is_frame_name(text_of(name, "frame"))) return false;
  NamedQuery query = query_at(target, source, stamp);
  Answer a;
  answer_query(tree, query, timeout_s, a);
  return a.failure.code == Code::ok;
}

template <Op op, class AnyTree>
LatestTransform latest(const AnyTree& tree, nb::handle target, nb::handle source) {
  const Answer a = answered(tree, query_of(op, target, source));
  return {{nb::borrow(target), nb::borrow(source), a.stamp, a.pose, a.gap}, a.newest};
}

template <class AnyTree>
nb::list latest_all(const AnyTree& tree, nb::handle pairs) {
  const nb::tuple items = tuple_of(pairs);
  std::vector<std::string_view> texts;
  std::vector<nb::object> names;  // target, source of each row
  for (const nb::handle item : items) {
    const nb::tuple pair = nb::steal<nb::tuple>(PySequence_Tuple(item.ptr()));
    if (!pair.is_valid() || pair.size() != 2) {
      PyErr_Clear();
      raise_invalid("pairs must hold (target_frame, source_frame) tuples", "pairs");
    }
    for (const auto& [i, field] : {std::pair{0, "target_frame"}, {1, "source_frame"}}) {
      texts.push_back(frame_name_of(names.emplace_back(pair[i]), field));
    }
  }
  LookupRows rows(std::move(texts));
  rows.size = items.size();
  std::vector<std::uint32_t> indexes(2 * rows.size);
  for (std::uint32_t i = 0; i < rows.size; ++i)
    indexes[i] = 2 * i, indexes[rows.size + i] = 2 * i + 1;
  constexpr auto kOp = static_cast<std::uint8_t>(Op::latest_xact);
  rows.op = {&kOp, true};
  rows.stamp = {&kNoStamp, true};
  rows.target = {indexes.data()};
  rows.source = {indexes.data() + rows.size};
  std::vector<Answer> answers(rows.size);
  {
    const GilReleasedOnWait released;
    ReadSet reads;
    (void)rows.find_names(tree);
    rows.look_up_at_once(tree, answers, reads);
  }
  nb::list out;
  for (std::size_t i = 0; i < answers.size(); ++i) {
    const Answer& a = answers[i];
    if (a.failure.code != Code::ok) raise_failure(tree, rows.named(i), a);
    out.append(LatestTransform{{names[2 * i], names[2 * i + 1], a.stamp, a.pose}, a.newest});
  }
  return out;
}

template <class AnyTree>
std::optional<Stamp> latest_common_time(const AnyTree& tree, nb::handle a, nb::handle b) {
  const Answer answer = answered(tree, query_of(Op::common_time, a, b));
  return answer.stamp == kNoStamp ? std::nullopt : std::optional(answer.stamp);
}

}  // namespace

template <class T>
void bind_lookups(nb::class_<T>& tree) {
  tree.def("lookup_transform", method<&lookup_at<T>>, ZTF_DOC(Reads_lookup_transform),
           name_arg("target"), name_arg("source"), nb::arg("stamp_ns").none() = nb::none(),
           nb::arg("timeout_s").none() = 0.0, nb::kw_only(),
           nb::arg("max_gap_s").none() = nb::none())
      .def("lookup_transform_full", method<&lookup_full<T>>, ZTF_DOC(Reads_lookup_transform_full),
           name_arg("target"), nb::arg("target_stamp_ns").none(), name_arg("source"),
           nb::arg("source_stamp_ns").none(), name_arg("fixed_frame"),
           nb::arg("timeout_s").none() = 0.0, nb::kw_only(),
           nb::arg("max_gap_s").none() = nb::none())
      .def("can_transform", method<&can<T>>, ZTF_DOC(Reads_can_transform), name_arg("target"),
           name_arg("source"), nb::arg("stamp_ns").none() = nb::none(),
           nb::arg("timeout_s").none() = 0.0)
      .def("lookup_latest_transform", method<&latest<Op::latest, T>>,
           ZTF_DOC(Reads_lookup_latest_transform), name_arg("target"), name_arg("source"))
      .def("lookup_latest_transform_xact", method<&latest<Op::latest_xact, T>>,
           ZTF_DOC(Reads_lookup_latest_transform_xact), name_arg("target"), name_arg("source"))
      .def("lookup_latest_transforms_xact", method<&latest_all<T>>,
           ZTF_DOC(Reads_lookup_latest_transforms_xact), nb::arg("pairs"))
      .def("latest_common_time", method<&latest_common_time<T>>, ZTF_DOC(Reads_latest_common_time),
           name_arg("a"), name_arg("b"));
}
template void bind_lookups(nb::class_<Tree>&);
template void bind_lookups(nb::class_<SharedTree>&);

}  // namespace ztf
