// Batches of lookups, each row its own transaction. Many times of one pair of frames go in blocks.
#include "tree_read.hpp"

namespace ztf {

namespace {

constexpr std::size_t kMinBlockRows = 8;  // fewer rows are faster one by one
constexpr int kBlockAttempts = 3;         // then row by row, because each row is answered in time

// Returns how many rows from the first on differ in nothing but their time.
std::size_t count_same_pair(std::span<const Query> queries) noexcept {
  const Query& first = queries[0];
  std::size_t n = 0;
  while (n < queries.size() && queries[n].op == Op::at && queries[n].target == first.target &&
         queries[n].source == first.source)
    ++n;
  return n;
}

}  // namespace

void Tree::lookup_batch(std::span<const Query> queries, std::span<Answer> answers) const {
  for (std::size_t i = 0; i < queries.size();) {
    const std::size_t same = count_same_pair(queries.subspan(i));
    const Query& first = queries[i];
    if (same < kMinBlockRows || first.target == 0 || first.source == 0 ||
        first.target == first.source) {
      const std::size_t end = i + std::max<std::size_t>(same, 1);
      for (; i < end; ++i) lookup(queries[i], answers[i]);
      continue;
    }
    const std::size_t end = i + same;
    while (i < end) {
      const std::size_t rows = std::min(SampleBlock::kRows, end - i);
      i += sample(queries.subspan(i, rows), answers.subspan(i, rows));
    }
  }
}

// Answers up to all rows of a block and returns how many, at least one.
std::size_t Tree::sample(std::span<const Query> queries, std::span<Answer> answers) const {
  SampleBlock block(queries, answers);
  bool valid = false;
  if (options_.concurrency == Concurrency::optimistic) {
    for (int i = 0; i < kBlockAttempts && !valid; ++i) {
      WalkGuard guard;
      valid = reader(guard).sample(block);
    }
  } else {
    ReadSet reads;
    read(reads, [&](auto& reader) { return reader.sample(block); });
    valid = true;
  }
  if (valid && answers[0].failure.code != Code::ok) return 1;
  for (std::size_t row = 0; row < queries.size(); ++row)
    if (!valid || block.unanswered(row)) lookup(queries[row], answers[row]);
  return queries.size();
}

}  // namespace ztf
