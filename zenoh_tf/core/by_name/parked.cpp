#include "by_name/parked.hpp"

#include <new>
#include <utility>

#include "base/rejected.hpp"
#include "system/host.hpp"

namespace ztf {

void ParkedRow::notify() noexcept { rows.queue().push(*this); }

ParkedRows::ParkedRows(const Tree& tree, WakeQueue& queue, LookupRows rows, std::uint64_t lookup_id,
                       std::size_t max_links)
    : tree_(tree),
      queue_(queue),
      rows_(std::move(rows)),
      lookup_id_(lookup_id),
      asked_at_ns_(real_time_ns()),
      max_links_(max_links),
      incomplete_(rows_.size + 1) {
  for (std::size_t i = 0; i < rows_.size; ++i)
    parked_.emplace_back(*this, rows_.named(i), rows_.fault(i).has_value());
}

bool ParkedRows::start() {
  for (ParkedRow& row : parked_)
    if (row.has_invalid_name || look_up(row)) --incomplete_;
  return --incomplete_ == 0;
}

void ParkedRows::cancel() {
  cancelled_ = true;
  for (ParkedRow& row : parked_) tree_.wait_list().cancel(row);
}

bool ParkedRows::look_up(ParkedRow& row) {
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

ParkedRows::Result ParkedRows::result(double waited_s) {
  Result result{std::vector<Answer>(parked_.size()), std::vector<std::string>(parked_.size())};
  (void)rows_.find_names(tree_);
  for (std::size_t i = 0; i < parked_.size(); ++i) {
    const ParkedRow& row = parked_[i];
    Answer& answer = result.answers[i];
    if (row.complete.load(std::memory_order_acquire)) {
      answer = row.answer();
      if (row.refused) {
        answer.failure.code = Code::limit;
        result.notes[i] = "the lookup cannot wait: all waiting lookups watch " +
                          std::to_string(max_links_) + " frames, the limit";
      }
      if (answer.failure.code == Code::ok) tree_.count_waited(row.waited_for(), asked_at_ns_);
    } else if (!row.has_invalid_name) {
      rows_.look_up_row(tree_, i, [&](const Query& query) { tree_.lookup(query, answer); });
      result.notes[i] = waited_for(waited_s);
    } else {
      answer.failure.code = Code::invalid_argument;
    }
    if (answer.failure.code != Code::ok) tree_.count_failed(answer.failure, asked_at_ns_);
  }
  return result;
}

std::uint64_t ParkedRows::links() {
  constexpr std::uint64_t kMost = 1'000'000'000;  // more are not counted
  (void)rows_.find_names(tree_);
  return rows_.links(tree_, kMost);
}

void WakeQueue::push(ParkedRow& row) noexcept {
  const std::lock_guard lock(mutex_);
  if (closed_) return;
  row.keep_alive = row.rows.weak_from_this().lock();
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
    const std::shared_ptr<ParkedRows> owner = std::move(row->keep_alive);
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
    if (row->rows.look_up_again(*row)) complete.push_back(row->rows.lookup_id());
    row = next;
  }
  return complete;
}

}  // namespace ztf
