// The tree's lookups, and reads of a single frame.
#include "lookups/lookup.hpp"

#include "lookups/transaction.hpp"

namespace ztf {

namespace {

[[gnu::noinline]] void lookup_guarded(const TreeState& tree, const Query& query, Answer& answer) {
  ReadSet reads;
  read(tree, reads, [&](auto& reader) { return reader.answer(query, answer); });
}

}  // namespace

ZTF_MULTIVERSION void lookup(const TreeState& tree, const Query& query, Answer& answer) {
  // A `full` lookup takes two walks one after the other, which a WalkGuard cannot validate
  // together.
  if (allows_optimistic_reads(tree) && query.op != Op::full) [[likely]] {
    const auto attempt = [&]() __attribute__((always_inline)) {
      WalkGuard guard;
      return reader_of(tree, guard).answer(query, answer);
    };
    if (retry(Optimistic::kAttempts, attempt)) [[likely]]
      return;
  }
  lookup_guarded(tree, query, answer);
}

void lookup_transaction(const TreeState& tree, std::span<const Query> queries,
                        std::span<Answer> answers, ReadSet& reads, std::size_t max_reads) {
  read(tree, reads,
       [&](auto& reader) { return answer_all(reader, queries, answers, reads, max_reads); });
}

Failure chain(const TreeState& tree, const Query& query, std::vector<FrameId>& frames) {
  ReadSet reads;
  Answer answer;
  read(tree, reads, [&](auto& reader) { return reader.chain(query, frames, answer); });
  return answer.failure;
}

std::vector<NamedInfo> ancestors(const TreeState& tree, std::span<const FrameId> starts,
                                 Stamp stamp) {
  ReadSet reads;
  std::vector<NamedInfo> found;
  read(tree, reads,
       [&](auto& reader) { return list_ancestors(reader, starts, stamp, tree.events, found); });
  return found;
}

bool may_succeed_later(const TreeState& tree, const Failure& failure) noexcept {
  switch (failure.code) {
    case Code::lookup:
      return failure.frame == 0;  // an unknown frame may be created, but a loop stays
    case Code::connectivity:
      return true;
    case Code::extrapolation:
    case Code::no_data:
    case Code::backward:
    case Code::forward: {
      const Stamp oldest = oldest_insertable(tree.info(failure.frame), tree.options);
      // If ids have passed on since, this may be another frame's.
      return failure.stamp >= oldest ||
             failure.ids_freed != tree.ids_freed.load(std::memory_order_acquire);
    }
    default:
      return false;
  }
}

}  // namespace ztf
