// Lookups by name that wait without a thread: one thread serves the rows of all of them.
//
// Each row of ParkedRows is a Waiter. A commit that may help pushes the row on the WakeQueue; the
// thread in WakeQueue::take() looks it up again, which parks it again or completes it.
//
// Thread safety: any thread may call anything.
// Lock order: the wait list's mutex, then the queue's.
// Invariant: a row is in the queue at most once, since only parking it again makes it wakeable.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "by_name/rows.hpp"
#include "tree.hpp"

namespace ztf {

class ParkedRows;

struct ParkedRow final : Waiter {
  ParkedRow(ParkedRows& rows, const NamedQuery& query, bool has_invalid_name)
      : Waiter(query, query.target_name, query.source_name, query.fixed_name),
        rows(rows),
        has_invalid_name(has_invalid_name) {}

  void notify() noexcept override;

  ParkedRows& rows;
  const bool has_invalid_name;
  std::atomic<bool> complete{false};
  bool refused = false;  // all waiting lookups watch as many frames as they may; before `complete`
  // While the row is in the queue, under the queue's mutex. Links in the row itself, so that a
  // wake-up allocates nothing and cannot fail.
  ParkedRow* next_woken = nullptr;
  std::shared_ptr<ParkedRows> keep_alive;
};

// Rows that were woken and must be looked up again. It keeps their owners alive until take() or
// close(), which hand them to the caller: they are never destroyed in a commit.
class WakeQueue {
 public:
  using Owners = std::vector<std::shared_ptr<ParkedRows>>;

  // Once the queue is closed it does nothing: nobody would let go of the owner. The owner is asked
  // for under the mutex, and only if it is kept. So it is never released here, where its destructor
  // must not run: in a commit, under the wait list's mutex.
  void push(ParkedRow& row) noexcept;
  // Blocks until rows are woken, then looks them up again. Returns the ids of the lookups that are
  // complete now; nothing once the queue is closed. Adds their owners. Throws bad_alloc.
  std::optional<std::vector<std::uint64_t>> take(Owners& owners);
  // Releases the owners that it keeps; no later wake-up adds any.
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
class ParkedRows : public std::enable_shared_from_this<ParkedRows> {
 public:
  // The tree, the queue, and what the rows refer to, must outlive it. `max_links`: frames that all
  // waiting lookups of the tree watch at most.
  ParkedRows(const Tree& tree, WakeQueue& queue, LookupRows rows, std::uint64_t lookup_id,
             std::size_t max_links);
  // Requires that it was cancelled since the last start(), which may wait for the wait list's
  // mutex.
  virtual ~ParkedRows() = default;
  ParkedRows(const ParkedRows&) = delete;
  ParkedRows& operator=(const ParkedRows&) = delete;

  // Looks up every row once. Returns true if all are complete.
  bool start();
  // Requires that the row was woken. Returns true if it was the last incomplete one.
  bool look_up_again(ParkedRow& row) {
    return !cancelled_.load() && look_up(row) && --incomplete_ == 0;
  }
  // No row is woken any more. May wait for those that wake rows now.
  void cancel();

  struct Result {
    std::vector<Answer> answers;
    std::vector<std::string> notes;  // how long each row has waited, or why it could not
  };
  // Rows that still wait fail as they would now. Counts the rows that were late.
  [[nodiscard]] Result result(double waited_s);
  // How many frames the rows will watch at most.
  [[nodiscard]] std::uint64_t links();

  [[nodiscard]] const Tree& tree() const noexcept { return tree_; }
  [[nodiscard]] const LookupRows& rows() const noexcept { return rows_; }
  [[nodiscard]] std::uint64_t lookup_id() const noexcept { return lookup_id_; }
  [[nodiscard]] WakeQueue& queue() const noexcept { return queue_; }

 private:
  bool look_up(ParkedRow& row);

  const Tree& tree_;
  WakeQueue& queue_;
  LookupRows rows_;
  const std::uint64_t lookup_id_;
  const std::int64_t asked_at_ns_;
  const std::size_t max_links_;
  std::deque<ParkedRow> parked_;  // a deque, since rows must not move
  // Rows, and one for start(): so exactly one caller sees it reach 0.
  std::atomic<std::size_t> incomplete_;
  std::atomic<bool> cancelled_{false};
};

}  // namespace ztf
