// The slots of the change log, and its consumer.
#include "records/change_log.hpp"

#include <cstring>
#include <new>
#include <utility>

namespace ztf {

LogEntry* LogEntry::make(std::size_t changes, std::size_t names, std::size_t name_bytes) {
  static_assert(alignof(Change) <= alignof(std::max_align_t) &&
                sizeof(LogEntry) % alignof(Change) == 0);
  const std::size_t bytes =
      sizeof(LogEntry) + changes * sizeof(Change) + names * sizeof(std::uint32_t) + name_bytes;
  auto* const entry = new (::operator new(bytes)) LogEntry;
  entry->bytes_ = bytes;
  entry->changes_room_ = changes;
  entry->names_room_ = names;
  return entry;
}

void LogEntry::free(LogEntry* entry) noexcept { ::operator delete(entry); }

std::uint32_t LogEntry::add_name(std::string_view name) noexcept {
  const std::uint32_t from = names_size_ == 0 ? 0 : ends()[names_size_ - 1];
  std::memcpy(text() + from, name.data(), name.size());
  ends()[names_size_] = from + static_cast<std::uint32_t>(name.size());
  return names_size_++;
}

ChangeLog::ChangeLog(std::uint64_t max_bytes) : max_bytes_(max_bytes), slots_(kSlots) {}

ChangeLog::~ChangeLog() {
  for (std::uint64_t i = 0; i < kSlots; ++i)
    LogEntry::free(entry_of(slots_[i].load(std::memory_order_relaxed)));
}

LogEntry* ChangeLog::make_entry(std::size_t changes, std::size_t names, std::size_t name_bytes) {
  if (!is_active()) return nullptr;
  LogEntry* const entry = LogEntry::make(changes, names, name_bytes);
  if (bytes_.fetch_add(entry->bytes(), std::memory_order_relaxed) + entry->bytes() <= max_bytes_)
    return entry;
  discard(entry);
  return nullptr;
}

void ChangeLog::discard(LogEntry* entry) noexcept {
  if (!entry) return;
  bytes_.fetch_sub(entry->bytes(), std::memory_order_relaxed);
  LogEntry::free(entry);
}

// Stores the number's word, unless a later lap's is there already: then the consumer finds that
// one, and knows that this one is lost.
void ChangeLog::publish(Seq seq, Word payload) noexcept {
  const Word word = Word{lap(seq)} << kLapShift | payload;
  std::atomic<Word>& slot = this->slot(seq);
  yield_point();
  Word before = slot.load(std::memory_order_relaxed);
  do {
    if (before != 0 && laps_behind(before, seq) < 0) {
      discard(entry_of(word));
      return;
    }
  } while (!slot.compare_exchange_weak(before, word, std::memory_order_seq_cst,
                                       std::memory_order_relaxed));
  discard(entry_of(before));
  // The store above and this load, and the consumer's in wait(), are sequentially consistent: one
  // of the two sees what the other has stored.
  if (waiting_.load(std::memory_order_seq_cst)) [[unlikely]]
    wake();
}

void ChangeLog::wake() noexcept {
  const std::lock_guard lock(mutex_);
  waiting_.store(false, std::memory_order_relaxed);
  woken_ = true;
  changed_.notify_all();
}

Seq ChangeLog::start() noexcept {
  // In this order: an entry whose number is drawn later is filled, or lost if its writer has looked
  // before.
  active_.store(true, std::memory_order_seq_cst);
  return position_ = last_drawn();
}

void ChangeLog::stop() noexcept {
  active_.store(false, std::memory_order_seq_cst);
  for (std::uint64_t i = 0; i < kSlots; ++i) {
    Word word = slots_[i].load(std::memory_order_relaxed);
    const Word lost = (word & ~kPayload) | kLost;
    if (entry_of(word) && slots_[i].compare_exchange_strong(word, lost)) discard(entry_of(word));
  }
}

void ChangeLog::wait(Clock::time_point deadline) {
  if (is_there()) return;
  std::unique_lock lock(mutex_);
  waiting_.store(true, std::memory_order_seq_cst);
  if (!is_there()) changed_.wait_until(lock, deadline, [&] { return woken_; });
  waiting_.store(false, std::memory_order_relaxed);
  // Only here, so that a wake() before the call is not lost.
  woken_ = false;
}

ChangeLog::Taken ChangeLog::take(std::size_t most_bytes) {
  Taken taken;
  taken.first = position_ + 1;
  for (std::size_t bytes = 0; bytes < most_bytes;) {
    taken.entries.reserve(taken.entries.size() + 1);  // may throw, so before the entry is taken
    std::atomic<Word>& slot = this->slot(position_ + 1);
    Word word = slot.load(std::memory_order_acquire);
    const int behind = word == 0 ? 1 : laps_behind(word, position_ + 1);
    if (behind > 0) break;  // not there yet
    const Word payload = word & kPayload;
    if (behind < 0 || payload == kLost) {
      taken.lost = true;
      break;
    }
    if (LogEntry* const entry = entry_of(word)) {
      // A writer that is a lap ahead may replace it, and free it then.
      if (!slot.compare_exchange_strong(word, (word & ~kPayload) | kEmpty)) continue;
      bytes_.fetch_sub(entry->bytes(), std::memory_order_relaxed);
      bytes += entry->bytes();
      taken.entries.emplace_back(entry);
    }
    ++position_;
  }
  taken.last = position_;
  return taken;
}

void LogTicket::publish_drawn() noexcept {
  if (!changes_something_) return;
  LogEntry* const entry = std::exchange(entry_, nullptr);
  const Seq seq = std::exchange(seq_, 0);
  if (entry)
    log_->publish_entry(seq, entry);
  else
    log_->publish_lost(seq);
}

void LogTicket::give_up() noexcept {
  log_->discard(entry_);
  if (seq_ != 0) log_->publish_empty(seq_);
}

}  // namespace ztf
