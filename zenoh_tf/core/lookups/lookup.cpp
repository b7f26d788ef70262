// The tree's lookups, and reads of a single frame.
#include "lookups/transaction.hpp"

namespace ztf {

// Answers `latest` without validation, each link consistent by itself (Reader::latest_each).
// Returns false if there is no chain, or if it changed during the lookup.
ZTF_MULTIVERSION bool Tree::latest_each(const Query& query, Answer& answer) const {
  if (query.target == 0 || query.source == 0 || query.target == query.source) return false;
  NoGuard guard;
  answer.failure.code = Code::ok;
  return reader(guard).latest_each(query.target, query.source, answer) &&
         answer.failure.code == Code::ok;
}

ZTF_MULTIVERSION void Tree::lookup(const Query& query, Answer& answer) const {
  // If latest_each() finds no chain, the lookups below decide on consistent data whether to fail.
  if (query.op == Op::latest && options_.concurrency != Concurrency::giant &&
      latest_each(query, answer))
    return;
  // A `full` lookup takes two walks one after the other, which a WalkGuard cannot validate
  // together.
  if (options_.concurrency == Concurrency::optimistic && query.op != Op::full) [[likely]] {
    for (int i = 0; i < kOptimisticAttempts; ++i) {
      WalkGuard guard;
      if (reader(guard).answer(query, answer)) [[likely]]
        return;
      count_retry();
    }
  }
  lookup_guarded(query, answer);
}

void Tree::lookup_guarded(const Query& query, Answer& answer) const {
  ReadSet reads;
  read(reads, [&](auto& reader) { return reader.answer(query, answer); });
}

void Tree::lookup_transaction(std::span<const Query> queries, std::span<Answer> answers,
                              ReadSet& reads, std::size_t max_reads) const {
  read(reads, [&](auto& reader) { return answer_all(reader, queries, answers, reads, max_reads); });
}

Failure Tree::chain(const Query& query, std::vector<FrameId>& frames) const {
  ReadSet reads;
  Answer answer;
  read(reads, [&](auto& reader) { return reader.chain(query, frames, answer); });
  return answer.failure;
}

std::vector<NamedInfo> Tree::ancestors(std::span<const FrameId> starts, Stamp stamp) const {
  ReadSet reads;
  std::vector<NamedInfo> found;
  read(reads, [&](auto& reader) { return list_ancestors(reader, starts, stamp, events_, found); });
  return found;
}

FrameId Tree::parent(FrameId id, Stamp stamp) const {
  const Frame& frame = frames_[id];
  return frame.version.read_consistent(
      [&](Version) noexcept { return parent_of(FrameAccess(frames_), frame, stamp); });
}

FrameInfo Tree::info(FrameId id) const {
  const Frame& frame = frames_[id];
  return frame.version.read_consistent(
      [&](Version version) noexcept { return info_of(frame, events_[id], version); });
}

Stamp Tree::oldest_insertable(const FrameInfo& info) const noexcept {
  if (info.samples == 0) return kNoStamp + 1;
  const Stamp by_age = span_ns(kNoStamp + 1, info.newest) <= options_.cache_ns
                           ? kNoStamp + 1
                           : info.newest - static_cast<Stamp>(options_.cache_ns);
  return info.samples == options_.max_samples_per_frame ? std::max(by_age, info.oldest) : by_age;
}

bool Tree::may_succeed_later(const Failure& failure) const noexcept {
  switch (failure.code) {
    case Code::lookup:
      return failure.frame == 0;  // an unknown frame may be created, but a loop stays
    case Code::connectivity:
      return true;
    case Code::extrapolation:
    case Code::no_data:
    case Code::backward:
    case Code::forward: {
      const Stamp oldest = oldest_insertable(info(failure.frame));
      // If ids have passed on since, this may be another frame's.
      return failure.stamp >= oldest ||
             failure.ids_freed != ids_freed_.load(std::memory_order_acquire);
    }
    default:
      return false;
  }
}

}  // namespace ztf
