// Waiting lookups that occupy no thread: one thread serves the rows of all of them.
//
// Each row of ParkedLookups is a Waiter. A commit that may help pushes the row on the WakeQueue;
// the thread in WakeQueue::take() looks it up again, which parks it again or completes it.
//
// Thread safety: any thread may call anything. The GIL is released while a thread looks rows up
// or sleeps.
// Lock order: the wait list's mutex, then the queue's.
// Invariant: a row is in the queue at most once, since only parking it again makes it wakeable.
#include <atomic>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>

#include <nanobind/stl/shared_ptr.h>

#include "base/host.hpp"
#include "bindings/reads/answer_columns.hpp"

namespace ztf {

namespace {

class ParkedLookups;

constexpr std::uint64_t kMostLinks = 1'000'000'000;  // more are not counted

struct ParkedRow final : Waiter {
  ParkedRow(ParkedLookups& lookups, const NamedQuery& query, bool has_invalid_name)
      : Waiter(query, query.target_name, query.source_name, query.fixed_name),
        lookups(lookups),
        has_invalid_name(has_invalid_name) {}

  void notify() noexcept override;

  ParkedLookups& lookups;
  const bool has_invalid_name;
  std::atomic<bool> complete{false};
  bool refused = false;  // all waiting lookups watch as many frames as they may; before `complete`
  // While the row is in the queue, under the queue's mutex. Links in the row itself, so that a
  // wake-up allocates nothing and cannot fail.
  ParkedRow* next_woken = nullptr;
  std::shared_ptr<ParkedLookups> keep_alive;
};

// Rows that were woken and must be looked up again.
class WakeQueue {
 public:
  using Owners = std::vector<std::shared_ptr<ParkedLookups>>;

  // Keeps the row's lookups alive until take() or close(). Once the queue is closed it does
  // nothing: nobody would let go of them. Their owner is asked for under the mutex, and only if it
  // is kept. So it is never released here, where the destructor must not run: in a commit, under
  // the wait list's mutex, without the GIL.
  void push(ParkedRow& row) noexcept;
  // Blocks until rows are woken, then looks them up again. Returns the ids of the lookups that
  // are complete now; nothing once the queue is closed. `owners` keeps the lookups alive: the
  // caller must release them under the GIL, which it must not hold here.
  std::optional<std::vector<std::uint64_t>> take(Owners& owners);
  // Releases the lookups that it keeps; no later wake-up adds any. Requires the GIL, as does the
  // destructor: lookups may be destroyed.
  void close();
  ~WakeQueue() { close(); }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  ParkedRow* first_ = nullptr;
  std::size_t size_ = 0;
  bool closed_ = false;
};

// Lookups of one request; complete once every row has an answer or can have none.
class ParkedLookups : public std::enable_shared_from_this<ParkedLookups> {
 public:
  ParkedLookups(nb::object tree, WakeQueue& queue, nb::tuple names, ReadColumns columns,
                LookupRows rows, std::uint64_t lookup_id, std::size_t max_links)
      : tree_object_(std::move(tree)),
        names_(std::move(names)),
        columns_(std::move(columns)),
        tree_(nb::cast<const Tree&>(tree_object_)),
        queue_(queue),
        rows_(std::move(rows)),
        lookup_id_(lookup_id),
        max_links_(max_links),
        incomplete_(rows_.size + 1) {
    for (std::size_t i = 0; i < rows_.size; ++i)
      parked_.emplace_back(*this, rows_.named(i), rows_.fault(i).has_value());
  }
  ~ParkedLookups() { cancel(); }

  // Looks up every row once. Returns true if all are complete.
  bool start() {
    for (ParkedRow& row : parked_)
      if (row.has_invalid_name || look_up(row)) --incomplete_;
    return --incomplete_ == 0;
  }
  // Requires that the row was woken. Returns true if it was the last incomplete one.
  bool look_up_again(ParkedRow& row) {
    return !cancelled_.load() && look_up(row) && --incomplete_ == 0;
  }
  // Requires the GIL, as does the destructor.
  void cancel() {
    const GilReleasedOnWait released;
    cancelled_ = true;
    for (ParkedRow& row : parked_) tree_.wait_list().cancel(row);
  }
  // As of _read_rows; rows that still wait fail as they would now.
  // Counts the rows that were late.
  nb::tuple result(double waited_s, bool errors, Budget* budget);
  // How many frames the rows will watch at most.
  [[nodiscard]] std::uint64_t links() {
    (void)rows_.find_names(tree_);
    return rows_.links(tree_, kMostLinks);
  }

  [[nodiscard]] std::uint64_t lookup_id() const noexcept { return lookup_id_; }
  [[nodiscard]] WakeQueue& queue() const noexcept { return queue_; }

 private:
  bool look_up(ParkedRow& row) {
    try {
      if (!tree_.lookup_or_park(row, max_links_)) return false;
    } catch (const Rejected&) {
      row.refused = true;
    } catch (const std::bad_alloc&) {
      row.refused = true;
    }
    row.complete.store(true, std::memory_order_release);
    return true;
  }
  [[nodiscard]] std::string refusal() const;

  const nb::object tree_object_;  // keeps the tree alive, even if only the queue keeps this alive
  const nb::tuple names_;         // keeps the texts of the rows alive
  const ReadColumns columns_;     // keeps the columns of the rows alive
  const Tree& tree_;
  WakeQueue& queue_;
  LookupRows rows_;
  const std::uint64_t lookup_id_;
  const std::int64_t asked_at_ns_ = real_time_ns();
  const std::size_t max_links_;   // of all waiting lookups of the tree
  std::deque<ParkedRow> parked_;  // a deque, since rows must not move
  // Rows, and one for start(): so exactly one caller sees it reach 0.
  std::atomic<std::size_t> incomplete_;
  std::atomic<bool> cancelled_{false};
};

void ParkedRow::notify() noexcept { lookups.queue().push(*this); }

nb::tuple ParkedLookups::result(double waited_s, bool errors, Budget* budget) {
  std::vector<Answer> answers(parked_.size());
  std::vector<std::string> notes(parked_.size());
  std::optional<GilReleasedOnWait> released(std::in_place);
  (void)rows_.find_names(tree_);
  for (std::size_t i = 0; i < parked_.size(); ++i) {
    if (parked_[i].complete.load(std::memory_order_acquire)) {
      answers[i] = parked_[i].answer();
      if (parked_[i].refused) {
        answers[i].failure.code = Code::limit;
        notes[i] = refusal();
      }
      if (answers[i].failure.code == Code::ok)
        tree_.count_waited(parked_[i].waited_for(), asked_at_ns_);
    } else if (!parked_[i].has_invalid_name) {
      rows_.look_up_row(tree_, i, [&](const Query& query) { tree_.lookup(query, answers[i]); });
      notes[i] = waited_for(waited_s);
    } else {
      answers[i].failure.code = Code::invalid_argument;
    }
    if (answers[i].failure.code != Code::ok) tree_.count_failed(answers[i].failure, asked_at_ns_);
  }
  released.reset();
  const FailureReport report{!tree_.startup().is_over(), errors, budget, std::move(notes)};
  AnswerColumns columns(answers.size(), report);
  columns.add(rows_, 0, answers);
  return reply(tree_, rows_, std::move(columns), report, nb::none());
}

std::string ParkedLookups::refusal() const {
  return "the lookup cannot wait: all waiting lookups watch " + std::to_string(max_links_) +
         " frames, the limit";
}

void WakeQueue::push(ParkedRow& row) noexcept {
  const std::lock_guard lock(mutex_);
  if (closed_) return;
  row.keep_alive = row.lookups.weak_from_this().lock();
  if (!row.keep_alive) return;  // being destroyed
  row.next_woken = first_;
  first_ = &row;
  ++size_;
  changed_.notify_one();
}

void WakeQueue::close() {
  ParkedRow* row;
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    row = std::exchange(first_, nullptr);
    size_ = 0;
    changed_.notify_all();
  }
  while (row) {  // without the mutex: a lookup's destructor takes the wait list's
    ParkedRow* const next = row->next_woken;
    const std::shared_ptr<ParkedLookups> owner = std::move(row->keep_alive);
    row = next;
  }
}

std::optional<std::vector<std::uint64_t>> WakeQueue::take(Owners& owners) {
  std::vector<std::uint64_t> complete;
  ParkedRow* row;
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || first_; });
    if (closed_) return std::nullopt;
    // Allocate first: a failure then leaves the queue as it is.
    owners.reserve(size_);
    complete.reserve(size_);
    row = std::exchange(first_, nullptr);
    size_ = 0;
  }
  while (row) {
    // Unlink the row first: once it is parked again, a commit may push it.
    ParkedRow* const next = std::exchange(row->next_woken, nullptr);
    owners.push_back(std::move(row->keep_alive));
    if (row->lookups.look_up_again(*row)) complete.push_back(row->lookups.lookup_id());
    row = next;
  }
  return complete;
}

}  // namespace

void bind_parked_lookups(nb::module_& m) {
  nb::class_<WakeQueue>(m, "WakeQueue", docs::WakeQueue.text)
      .def(nb::init<>())
      .def(
          "take",
          [](WakeQueue& queue) {
            WakeQueue::Owners owners;
            const GilReleased released;
            return queue.take(owners);
          },
          ZTF_DOC(WakeQueue_take))
      .def("close", &WakeQueue::close);

  nb::class_<ParkedLookups>(m, "ParkedLookups", docs::ParkedLookups.text)
      .def("start", &ParkedLookups::start, ZTF_DOC(ParkedLookups_start),
           nb::call_guard<GilReleased>())
      .def("cancel", &ParkedLookups::cancel)
      .def("links", &ParkedLookups::links, nb::call_guard<GilReleased>())
      .def("result", &ParkedLookups::result, ZTF_DOC(ParkedLookups_result), nb::arg("waited_s"),
           nb::arg("errors") = true, nb::arg("budget").none() = nb::none());
  m.def(
      "park_lookups",
      [](nb::object tree, WakeQueue& queue, std::uint64_t lookup_id, nb::handle names,
         const Column<std::uint8_t>& op, const Column<std::uint32_t>& target,
         const Column<std::uint32_t>& source, const Column<Stamp>& stamp,
         const std::optional<Column<std::uint32_t>>& fixed,
         const std::optional<Column<Stamp>>& source_stamp, std::size_t max_links, Stamp max_gap) {
        const auto& of = nb::cast<const Tree&>(tree);
        ReadColumns columns{op, target, source, stamp, fixed, source_stamp, max_gap};
        columns.check();
        std::vector<std::string_view> texts;
        nb::tuple kept = names_of(of.options(), names, texts, "names");
        LookupRows rows(std::move(texts));
        rejected_as_error([&] { columns.set(rows); });
        return std::make_shared<ParkedLookups>(std::move(tree), queue, std::move(kept),
                                               std::move(columns), std::move(rows), lookup_id,
                                               max_links);
      },
      nb::arg("tree"), nb::arg("queue"), nb::arg("lookup_id"), nb::arg("names"), nb::arg("op"),
      nb::arg("target"), nb::arg("source"), nb::arg("stamp_ns"),
      nb::arg("fixed").none() = nb::none(), nb::arg("source_stamp_ns").none() = nb::none(),
      nb::arg("max_links") = static_cast<std::size_t>(-1), nb::arg("max_gap_ns") = kNoGapLimit,
      nb::keep_alive<0, 2>());
}

}  // namespace ztf
