// How an interest is read at one instant.
#include "replication/interest_reader.hpp"

#include <algorithm>
#include <chrono>
#include <string>

#include "base/rejected.hpp"
#include "commits/write_locks.hpp"

namespace ztf {

namespace {

// A read that takes longer than the time between two commits fails each time, and the more there is
// to read, the longer it takes. So attempts that have taken this long in all are enough: a mirror
// that waits for its first copy would give up before 32 of long histories.
constexpr int kOptimisticReads = 32;
constexpr auto kOptimisticTime = std::chrono::milliseconds(20);

}  // namespace

bool InterestReader::has_changed() const {
  const std::lock_guard lock(mutex_);
  return paths_.may_differ() || difference_.has_changed();
}

InterestReader::Result InterestReader::read(bool with_all, std::size_t max_frames) {
  const std::lock_guard lock(mutex_);
  const auto until = std::chrono::steady_clock::now() + kOptimisticTime;
  int attempts = kOptimisticReads;
  do {
    if (std::optional<Result> result = try_read(with_all, max_frames)) return std::move(*result);
  } while (--attempts > 0 && std::chrono::steady_clock::now() < until);
  return read_locked(with_all, max_frames);
}

std::optional<InterestReader::Result> InterestReader::try_read(bool with_all,
                                                               std::size_t max_frames) {
  // A commit with a number up to this one makes readers wait for its frames (WriteLocks). If it
  // adds names, it also holds the topology mutex, until the names can be found.
  const Seq seq = last_number();
  {
    const auto topology = lock_announced(tree_.topology);
  }
  paths_.find(max_frames);
  if (paths_.frames().size() > max_frames) {
    yield_point();
    if (!paths_.is_valid()) return std::nullopt;
    check_frames(max_frames);
  }
  copy_frames(with_all);
  // Before the comparison, which is for the names, too.
  Result result = make_result(seq, with_all);
  if (!is_valid()) return std::nullopt;
  // A mirror applies changes only under a number that is new to it. The last read returned all
  // commits up to its number, those in progress included, as above. So the new changes are of a
  // later commit. It drew its number before it stored anything: perhaps just after `seq` was
  // loaded. A thread that sees its changes also sees its number, so the next attempt has a later
  // one. That may be another commit's; then this commit is sent early, and only once.
  if (!result.changes.kind.empty() && seq <= sent_seq_) return std::nullopt;
  keep(result);
  return result;
}

// Holds the locks of all frames that it reads, so that they do not change. The topology mutex keeps
// links and names as they are.
InterestReader::Result InterestReader::read_locked(bool with_all, std::size_t max_frames) {
  const auto giant = lock_transaction(tree_);
  const auto topology = lock_announced(tree_.topology);
  paths_.find(kNoReadLimit);
  FrameList ascending;
  for (const FrameId id : paths_.frames()) ascending.push_back(id);
  std::sort(ascending.begin(), ascending.end());
  const WriteLocks locks(tree_, ascending, true);
  // None of these frames changes any more, so what is new has a number up to this one.
  const Seq seq = last_number();
  paths_.find(kNoReadLimit);
  check_frames(max_frames);
  copy_frames(with_all);
  Result result = make_result(seq, with_all);
  keep(result);
  return result;
}

// The number of the last commit. In a mirror's tree, which nobody else writes, that is the last one
// that was replayed; its owner lets nothing be replayed during a read.
Seq InterestReader::last_number() const noexcept {
  return std::max(tree_.change_log->last_drawn(), tree_.replayed.load(std::memory_order_acquire));
}

// Throws Rejected if find() has found more frames. Requires that what it has read is valid: a torn
// walk may find more.
void InterestReader::check_frames(std::size_t max_frames) const {
  const std::size_t frames = paths_.frames().size();
  if (frames <= max_frames) return;
  throw Rejected{.code = Code::limit,
                 .message = "the paths of the interest have more than " +
                            std::to_string(max_frames) + " frames",
                 .field = "interest_frames",
                 .limit = static_cast<std::int64_t>(max_frames),
                 .value = static_cast<std::int64_t>(frames)};
}

void InterestReader::copy_frames(bool with_all) {
  copies_.clear();
  for (const FrameId id : paths_.frames())
    if (std::optional<InterestCopy> copy = difference_.copy(id, with_all))
      copies_.push_back(std::move(*copy));
}

// Whether all that was read was the tree's state at one instant.
bool InterestReader::is_valid() const {
  yield_point();
  for (const InterestCopy& copy : copies_)
    if (tree_.version(copy.id) != copy.version || (copy.is_new && copy.ref.id != copy.id))
      return false;
  return paths_.is_valid();
}

// Makes the result of a read, which may turn out to be invalid.
InterestReader::Result InterestReader::make_result(Seq seq, bool with_all) {
  const bool ever_reparented = tree_.ever_reparented.load();
  return {seq, ever_reparented, difference_.changes(paths_.frames(), copies_, ever_reparented),
          with_all ? difference_.all(copies_) : ChangeTable{}};
}

void InterestReader::keep(const Result& result) {
  difference_.keep(copies_, result.ever_reparented);
  paths_.keep();
  sent_seq_ = result.seq;
  sent_frames_.store(difference_.size(), std::memory_order_relaxed);
}

}  // namespace ztf
