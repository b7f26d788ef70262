// Batches of lookups, each row its own transaction. Rows of one pair of frames at many times are
// answered in blocks.
#include "lookups/transaction.hpp"
#include "shared/transaction.hpp"

namespace ztf {

namespace {

constexpr std::size_t kMinBlockRows = 8;  // fewer rows are faster one by one
constexpr int kBlockAttempts = 3;         // then row by row, which always ends

// Returns how many rows from the first on are `at` and differ in nothing but their time; 0 if the
// first row is no `at`.
std::size_t count_same_pair(std::span<const Query> queries) noexcept {
  const Query& first = queries[0];
  std::size_t n = 0;
  while (n < queries.size() && queries[n].op == Op::at && queries[n].target == first.target &&
         queries[n].source == first.source && queries[n].max_gap == first.max_gap)
    ++n;
  return n;
}

// Looks up rows one by one with lookup_one(query, answer), or with lookup_block(queries, answers),
// which returns how many it has answered.
template <class LookupOne, class LookupBlock>
void look_up_batch(LookupOne&& lookup_one, std::span<const Query> queries,
                   std::span<Answer> answers, LookupBlock&& lookup_block) {
  for (std::size_t i = 0; i < queries.size();) {
    const std::size_t same = count_same_pair(queries.subspan(i));
    const Query& first = queries[i];
    if (same < kMinBlockRows || first.target == 0 || first.source == 0 ||
        first.target == first.source) {
      const std::size_t end = i + std::max<std::size_t>(same, 1);
      for (; i < end; ++i) lookup_one(queries[i], answers[i]);
      continue;
    }
    const std::size_t end = i + same;
    while (i < end) {
      const std::size_t rows = std::min(SampleBlock::kRows, end - i);
      i += lookup_block(queries.subspan(i, rows), answers.subspan(i, rows));
    }
  }
}

// Looks up what a block has not answered. Returns how many rows are answered then: all, or only the
// first, if that one failed.
template <class LookupOne>
std::size_t complete_block(LookupOne&& lookup_one, const SampleBlock& block, bool valid,
                           std::span<const Query> queries, std::span<Answer> answers) {
  if (valid && answers[0].failure.code != Code::ok) return 1;
  for (std::size_t row = 0; row < queries.size(); ++row)
    if (!valid || block.unanswered(row)) lookup_one(queries[row], answers[row]);
  return queries.size();
}

auto one_of(const TreeState& tree) {
  return [&tree](const Query& query, Answer& answer) { lookup(tree, query, answer); };
}
auto one_of(const SharedTree& tree) {
  return [&tree](const Query& query, Answer& answer) { tree.lookup(query, answer); };
}

// Answers the rows of a block and returns how many it answered: all, or only the first, if that one
// fails.
std::size_t lookup_block(const TreeState& tree, std::span<const Query> queries,
                         std::span<Answer> answers) {
  SampleBlock block(queries, answers);
  bool valid = true;
  if (allows_optimistic_reads(tree)) {
    valid = retry(kBlockAttempts, [&] {
      WalkGuard guard;
      return reader_of(tree, guard).answer_block(block);
    });
  } else {
    ReadSet reads;
    read(tree, reads, [&](auto& reader) { return reader.answer_block(block); });
  }
  return complete_block(one_of(tree), block, valid, queries, answers);
}

}  // namespace

void lookup_batch(const TreeState& tree, std::span<const Query> queries,
                  std::span<Answer> answers) {
  look_up_batch(one_of(tree), queries, answers,
                [&](auto some, auto them) { return lookup_block(tree, some, them); });
}

void SharedTree::lookup_batch(std::span<const Query> queries, std::span<Answer> answers) const {
  look_up_batch(one_of(*this), queries, answers,
                [this](auto some, auto them) { return lookup_block(some, them); });
}

std::size_t SharedTree::lookup_block(std::span<const Query> queries,
                                     std::span<Answer> answers) const {
  SampleBlock block(queries, answers);
  const bool valid = try_read(kBlockAttempts, [&](const MappedFrames& frames, Patience& patience) {
    PatientWalkGuard guard(patience);
    return reader_of(frames, guard).answer_block(block);
  });
  return complete_block(one_of(*this), block, valid, queries, answers);
}

}  // namespace ztf
