// The change log: every commit's changes, in an order that is a serial order of the commits.
//
// Each commit that changes something draws a number, `seq`, from one counter. It does so at its
// linearization point: after readers wait for all frames of its write set, and before its read set
// is compared. Two commits that write one frame draw in the order of their locks. If a commit has
// read what another writes, its comparison would find the other's mark had the other drawn first.
// So the numbers of commits that depend on each other are in their serial order
// (docs/explanation/concurrency.md).
//
// Thread safety: writers draw and publish from any thread, without waiting. start(), stop(), wait()
// and take() are the consumer's, one thread at a time. The rest, from any thread.
// Invariants
// 1. Every number that was drawn is published exactly once: with an entry, as empty (the commit was
//    rejected, or changed nothing), or as lost (nobody listens, or there is no room).
// 2. The consumer gets the entries in the order of their numbers, without a gap, or learns that the
//    next one is lost.
// 3. The entries' bytes never exceed the limit.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string_view>
#include <vector>

#include "base/yield_point.hpp"
#include "records/frame.hpp"
#include "system/zeroed_array.hpp"

namespace ztf {

using Seq = std::uint64_t;  // 1, 2, ...

// What a commit did to one frame. The numbers are those of the protocol.
enum class ChangeKind : std::uint8_t {
  sample = 0,       // a dynamic sample was stored
  static_link = 1,  // a static link was stored: it replaces the history
  created = 2,      // the frame exists now, without a link of its own
  cleared = 3,      // the frame lost its link and history
  removed = 4,      // and its name
  new_version = 5,  // only the version; from now on, frames may have samples of several parents
  orphaned = 6,     // the samples of one past parent have none any more: its name lost its id
};

constexpr bool has_sample(ChangeKind kind) noexcept { return kind <= ChangeKind::static_link; }

// No parent, where an index of a name is expected.
constexpr std::uint32_t kNoParent = ~std::uint32_t{0};

struct Change {
  ChangeKind kind;
  std::uint32_t frame;  // as is `parent`: index of a name of the entry
  // If has_sample(), as are `stamp` and `pose`. If orphaned: the past parent, or kNoParent if only
  // the version is new.
  std::uint32_t parent;
  Version version;  // of the frame after the commit
  Stamp stamp;
  Pose pose;
};

// One commit's changes, in order, in one block of memory.
class LogEntry {
 public:
  // Throws bad_alloc.
  static LogEntry* make(std::size_t changes, std::size_t names, std::size_t name_bytes);
  static void free(LogEntry* entry) noexcept;

  // Both require room.
  std::uint32_t add_name(std::string_view name) noexcept;
  void add(const Change& change) noexcept { changes()[changes_size_++] = change; }
  void set_authority(std::uint32_t name) noexcept { authority_ = name; }

  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] std::size_t size() const noexcept { return changes_size_; }
  [[nodiscard]] const Change* begin() const noexcept { return changes(); }
  [[nodiscard]] const Change* end() const noexcept { return changes() + changes_size_; }
  [[nodiscard]] std::string_view name(std::uint32_t i) const noexcept {
    const std::uint32_t from = i == 0 ? 0 : ends()[i - 1];
    return {text() + from, ends()[i] - from};
  }
  [[nodiscard]] std::uint32_t names() const noexcept { return names_size_; }
  // The authority of all samples and links of the entry.
  [[nodiscard]] std::string_view authority() const noexcept {
    return authority_ == kNone ? std::string_view() : name(authority_);
  }

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  LogEntry() = default;
  [[nodiscard]] Change* changes() const noexcept {
    return reinterpret_cast<Change*>(
        const_cast<std::byte*>(reinterpret_cast<const std::byte*>(this)) + sizeof(LogEntry));
  }
  [[nodiscard]] std::uint32_t* ends() const noexcept {
    return reinterpret_cast<std::uint32_t*>(changes() + changes_room_);
  }
  [[nodiscard]] char* text() const noexcept {
    return reinterpret_cast<char*>(ends() + names_room_);
  }

  std::size_t bytes_ = 0;
  std::size_t changes_room_ = 0, names_room_ = 0;
  std::uint32_t changes_size_ = 0, names_size_ = 0;
  std::uint32_t authority_ = kNone;
};

struct FreeEntry {
  void operator()(LogEntry* entry) const noexcept { LogEntry::free(entry); }
};
using LogEntryPtr = std::unique_ptr<LogEntry, FreeEntry>;

class ChangeLog {
 public:
  using Clock = std::chrono::steady_clock;

  explicit ChangeLog(std::uint64_t max_bytes);
  ~ChangeLog();
  ChangeLog(const ChangeLog&) = delete;
  ChangeLog& operator=(const ChangeLog&) = delete;

  // The writers' part (LogTicket).
  // Returns an entry with this room, or null if it would be lost. Throws bad_alloc.
  LogEntry* make_entry(std::size_t changes, std::size_t names, std::size_t name_bytes);
  void discard(LogEntry* entry) noexcept;  // may be null
  Seq draw() noexcept {
    yield_point();
    return drawn_.fetch_add(1, std::memory_order_acq_rel) + 1;
  }
  void publish_empty(Seq seq) noexcept { publish(seq, kEmpty); }
  void publish_lost(Seq seq) noexcept { publish(seq, kLost); }
  void publish_entry(Seq seq, LogEntry* entry) noexcept {
    publish(seq, reinterpret_cast<Word>(entry));
  }

  [[nodiscard]] bool is_active() const noexcept { return active_.load(std::memory_order_acquire); }
  // The last number that was drawn. Its commit, and those before it, may still be in progress.
  [[nodiscard]] Seq last_drawn() const noexcept { return drawn_.load(std::memory_order_acquire); }

  // The consumer's part.
  // Starts, or restarts: the next entry is the first whose number is drawn after this call.
  // Returns the number before it.
  Seq start() noexcept;
  // Entries are lost until the next start().
  void stop() noexcept;
  // Waits until the next entry is there, or lost, until the deadline, or until wake().
  void wait(Clock::time_point deadline);
  void wake() noexcept;

  struct Taken {
    std::vector<LogEntryPtr> entries;  // without the empty ones
    Seq first = 0, last = 0;           // of all taken; last is first - 1 if there was none
    bool lost = false;                 // the next one is lost: call start()
  };
  // Takes the entries that are there, until they have `most_bytes` or more. Throws bad_alloc.
  Taken take(std::size_t most_bytes);

  [[nodiscard]] std::uint64_t bytes() const noexcept {
    return bytes_.load(std::memory_order_relaxed);
  }

 private:
  // A slot's word: 16 bits that count how often the numbers have passed the slot, and an address,
  // or kEmpty or kLost. 0 is a slot that was never used.
  using Word = std::uint64_t;
  static constexpr unsigned kLapShift = 48;
  static constexpr Word kEmpty = 1, kLost = 2, kPayload = (Word{1} << kLapShift) - 1;
  static constexpr std::uint64_t kSlots = 1 << 15;

  static std::uint16_t lap(Seq seq) noexcept {
    return static_cast<std::uint16_t>(seq / kSlots + 1);
  }
  static LogEntry* entry_of(Word word) noexcept {
    const Word payload = word & kPayload;
    return payload > kLost ? reinterpret_cast<LogEntry*>(payload) : nullptr;
  }
  // How many laps the slot is behind the number's; 0: it has the number's word; negative: ahead.
  static int laps_behind(Word word, Seq seq) noexcept {
    return static_cast<std::int16_t>(
        static_cast<std::uint16_t>(lap(seq) - static_cast<std::uint16_t>(word >> kLapShift)));
  }
  std::atomic<Word>& slot(Seq seq) const noexcept { return slots_[seq % kSlots]; }
  void publish(Seq seq, Word payload) noexcept;
  [[nodiscard]] bool is_there() const noexcept {
    const Word word = slot(position_ + 1).load(std::memory_order_seq_cst);
    return word != 0 && laps_behind(word, position_ + 1) <= 0;
  }

  const std::uint64_t max_bytes_;
  const ZeroedArray<std::atomic<Word>> slots_;
  alignas(64) std::atomic<Seq> drawn_{0};
  alignas(64) std::atomic<std::uint64_t> bytes_{0};
  std::atomic<bool> active_{false};
  std::atomic<bool> waiting_{false};  // the consumer waits for its next entry
  Seq position_ = 0;                  // the consumer's: the last number that it has taken
  std::mutex mutex_;                  // only to wake the consumer
  std::condition_variable changed_;
  bool woken_ = false;  // guarded by the mutex
};

// One commit's number and entry. Without a log it does nothing.
//
// Thread safety: lives on the writer's stack.
class LogTicket {
 public:
  explicit LogTicket(ChangeLog* log) noexcept : log_(log) {}
  ~LogTicket() {
    if (log_) [[unlikely]]
      give_up();
  }
  LogTicket(const LogTicket&) = delete;
  LogTicket& operator=(const LogTicket&) = delete;

  [[nodiscard]] bool wants_entry() const noexcept { return log_ && log_->is_active(); }
  // Returns the entry to fill, or null if nobody wants it. Throws bad_alloc.
  LogEntry* make_entry(std::size_t changes, std::size_t names, std::size_t name_bytes) {
    return entry_ = log_->make_entry(changes, names, name_bytes);
  }
  // The commit needs no number, as it changes nothing.
  void changes_nothing() noexcept { changes_something_ = false; }
  // To be called at the linearization point. Further calls do nothing.
  void draw() noexcept {
    if (log_) [[unlikely]]
      if (seq_ == 0 && changes_something_) seq_ = log_->draw();
  }
  // To be called when the changes are stored.
  void publish() noexcept {
    if (log_) [[unlikely]]
      publish_drawn();
  }

 private:
  void publish_drawn() noexcept;
  // A number that was drawn in vain becomes an empty entry.
  void give_up() noexcept;

  ChangeLog* const log_;
  LogEntry* entry_ = nullptr;
  bool changes_something_ = true;
  Seq seq_ = 0;
};

}  // namespace ztf
