// Waiting lookups that hold no thread: one thread serves the rows of all of them.
//
// Thread safety: all of it; the interpreter lock is released while a thread
// asks the tree or sleeps.
// Lock order: the waiting room's mutex, then the queue's.
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>

#include <nanobind/stl/shared_ptr.h>

#include "rows.hpp"

namespace ztf {

namespace {

class WaitingRows;

// The rows that were woken and must be asked again.
class WaitQueue {
 public:
  struct Woken {
    std::shared_ptr<WaitingRows> rows;
    std::size_t row;
  };
  void push(Woken woken) {
    const std::lock_guard lock(mutex_);
    woken_.push_back(std::move(woken));
    changed_.notify_one();
  }
  // Sleeps until some are woken, and asks them. The tokens of those that are
  // over now; nothing once it is closed. `held` is to be freed under the
  // interpreter lock, which is not held here.
  std::optional<std::vector<std::uint64_t>> take(std::deque<Woken>& held);
  void close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Woken> woken_;
  bool closed_ = false;
};

// Lookups that wait, each for itself; over when all are.
class WaitingRows : public std::enable_shared_from_this<WaitingRows> {
 public:
  WaitingRows(const Tree& tree, WaitQueue& queue, ReadRows rows, std::uint64_t token)
      : tree_(tree),
        queue_(queue),
        rows_(std::move(rows)),
        token_(token),
        left_(rows_.queries.size() + 1) {
    for (std::size_t i = 0; i < rows_.queries.size(); ++i) {
      const auto [target, source, fixed] = rows_.names[i];
      const bool full = rows_.queries[i].op == Op::full;
      waiting_.emplace_back(*this, i, rows_.queries[i], rows_.texts[target], rows_.texts[source],
                            full ? rows_.texts[fixed] : std::string_view());
    }
  }
  ~WaitingRows() { cancel(); }

  // True where all are over already.
  bool start() {
    for (std::size_t i = 0; i < waiting_.size(); ++i)
      if (waiting_[i].hopeless || ask(i)) --left_;
    return --left_ == 0;
  }
  // True: this was the last one. Only for who was woken.
  bool ask_again(std::size_t i) { return !cancelled_.load() && ask(i) && --left_ == 0; }
  [[nodiscard]] std::uint64_t token() const noexcept { return token_; }
  void cancel() {
    cancelled_ = true;
    for (Row& row : waiting_) tree_.wait_list().cancel(row);
  }
  // As in read_rows; rows that still wait fail as they would now.
  nb::tuple result(double waited_s) {
    std::vector<Answer> answers(waiting_.size());
    std::vector<std::string> notes(waiting_.size());
    for (std::size_t i = 0; i < waiting_.size(); ++i) {
      if (waiting_[i].over.load(std::memory_order_acquire)) {
        answers[i] = waiting_[i].answer();
        rows_.queries[i] = waiting_[i].query();
      } else if (!waiting_[i].hopeless) {
        ask_now(rows_.queries[i], i, answers[i]);
        notes[i] = waited(waited_s);
      } else {
        answers[i].failure.code = Code::invalid_argument;
      }
    }
    return reply(tree_, rows_, answers, notes, nb::none());
  }

 private:
  struct Row final : Waiter {
    Row(WaitingRows& of, std::size_t index, const Query& query, std::string_view target,
        std::string_view source, std::string_view fixed)
        : Waiter(query, target, source, fixed),
          hopeless(of.rows_.has_bad_name(index)),
          of(of),
          index(index) {}
    void notify() noexcept override {
      if (auto rows = of.weak_from_this().lock()) of.queue_.push({std::move(rows), index});
    }

    const bool hopeless;  // with names that no frame can have
    std::atomic<bool> over{false};
    WaitingRows& of;
    const std::size_t index;
  };

  bool ask(std::size_t i) {
    if (!tree_.wait_list().lookup_or_park(waiting_[i])) return false;
    waiting_[i].over.store(true, std::memory_order_release);
    return true;
  }
  void ask_now(Query& query, std::size_t i, Answer& answer) const {
    const auto [target, source, fixed] = rows_.names[i];
    query.target = tree_.find(rows_.texts[target]);
    query.source = tree_.find(rows_.texts[source]);
    if (query.op == Op::full) query.fixed = tree_.find(rows_.texts[fixed]);
    tree_.lookup(query, answer);
  }

  const Tree& tree_;
  WaitQueue& queue_;
  ReadRows rows_;
  const std::uint64_t token_;
  std::deque<Row> waiting_;        // they do not move
  std::atomic<std::size_t> left_;  // and one for start(), so that one alone sees the last go
  std::atomic<bool> cancelled_{false};
};

std::optional<std::vector<std::uint64_t>> WaitQueue::take(std::deque<Woken>& held) {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || !woken_.empty(); });
    if (closed_) return std::nullopt;
    held.swap(woken_);
  }
  std::vector<std::uint64_t> over;
  for (const Woken& woken : held)
    if (woken.rows->ask_again(woken.row)) over.push_back(woken.rows->token());
  return over;
}

}  // namespace

void bind_waiting(nb::module_& m) {
  nb::class_<WaitQueue>(m, "WaitQueue")
      .def(nb::init<>())
      .def("take",
           [](WaitQueue& queue) {
             std::deque<WaitQueue::Woken> held;
             const Unlocked unlocked;
             return queue.take(held);
           })
      .def("close", &WaitQueue::close);

  nb::class_<WaitingRows>(m, "WaitingRows")
      .def("start", &WaitingRows::start, nb::call_guard<nb::gil_scoped_release>())
      .def("cancel", &WaitingRows::cancel)
      .def("result", &WaitingRows::result, nb::arg("waited_s"));
  m.def(
      "waiting_rows",
      [](const Tree& tree, WaitQueue& queue, std::uint64_t token, nb::handle names,
         const Column<std::uint8_t>& op, const Column<std::uint32_t>& target,
         const Column<std::uint32_t>& source, const Column<Stamp>& stamp,
         const std::optional<Column<std::uint32_t>>& fixed,
         const std::optional<Column<Stamp>>& source_stamp) {
        return std::make_shared<WaitingRows>(
            tree, queue, ReadRows(tree, names, op, target, source, stamp, fixed, source_stamp),
            token);
      },
      nb::arg("tree"), nb::arg("queue"), nb::arg("token"), nb::arg("names"), nb::arg("op"),
      nb::arg("target"), nb::arg("source"), nb::arg("stamp_ns"),
      nb::arg("fixed").none() = nb::none(), nb::arg("source_stamp_ns").none() = nb::none(),
      nb::keep_alive<0, 1>(), nb::keep_alive<0, 2>());
}

}  // namespace ztf
