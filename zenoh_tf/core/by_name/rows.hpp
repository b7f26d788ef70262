// Many lookups by name: rows of columns that refer to a list of names.
//
// Thread safety: for one thread at a time.
#pragma once

#include <algorithm>
#include <span>
#include <string_view>
#include <tuple>
#include <vector>

#include "by_name/errors.hpp"
#include "names/reader.hpp"
#include "reads/guards.hpp"
#include "reads/sample_block.hpp"

namespace ztf {

// A column of a lookup: a value for each row, or one for all. The values must outlive it, and must
// not change.
template <class T>
struct RowValues {
  const T* values = nullptr;  // null: no row has one
  bool single = false;

  T operator[](std::size_t row) const noexcept { return values[single ? 0 : row]; }
};

class LookupRows {
 public:
  // The texts of the names must outlive the rows. They may be such that no frame can have them: a
  // row with one fails.
  explicit LookupRows(std::vector<std::string_view> names)
      : names(std::move(names)), refs_(this->names.size()) {}

  std::vector<std::string_view> names;
  std::size_t size = 0;
  RowValues<std::uint8_t> op;
  RowValues<std::uint32_t> target, source, fixed;  // indexes into the names; fixed: for Op::full
  RowValues<Stamp> stamp, source_stamp;            // of Query
  Stamp max_gap = kNoGapLimit;                     // ns, of all rows
  bool one_instant = false;                        // Op::latest is as Op::latest_xact

  // Throws Rejected for a row that is malformed.
  void check() const;
  // Finds the ids of all names, which what follows requires. Returns whether every name has the id
  // that was found before. Otherwise answers may be another frame's, or from before a frame was
  // created.
  template <class AnyTree>
  bool find_names(const AnyTree& tree);

  // A row's query, with the ids that were found last.
  [[nodiscard]] Query query(std::size_t row) const noexcept {
    Query query;
    set({&query, 1}, row);
    return query;
  }
  [[nodiscard]] NamedQuery named(std::size_t row) const noexcept;
  // Why a name of the row can be no frame's; nullopt if all can.
  [[nodiscard]] std::optional<Rejected> fault(std::size_t row) const;
  // The names of frames that do not exist.
  [[nodiscard]] std::vector<std::string_view> unknown_names() const;
  // The links that the rows climb at most, by the newest parents; if that is more than `most`, any
  // number above it. Costs a walk for each name that a row uses.
  template <class AnyTree>
  [[nodiscard]] std::uint64_t links(const AnyTree& tree, std::uint64_t most) const;

  // Calls look_up(query) for one row, again if a name of it has lost its id meanwhile.
  template <class AnyTree, class LookUp>
  void look_up_row(const AnyTree& tree, std::size_t row, LookUp&& look_up) {
    do {
      look_up(query(row));
    } while (find_lost_names(tree, row));
  }
  // Looks up each row by itself. Calls add(first row, answers) for some rows at a time: their
  // answers then stay in the processor's cache.
  template <class AnyTree, class Add>
  void look_up_each(const AnyTree& tree, Add&& add) {
    const std::size_t most = std::min(kRowsAtOnce, size);
    std::vector<Query> queries(most);
    std::vector<Answer> answers(most);
    for (std::size_t first = 0; first < size; first += most) {
      const std::size_t count = std::min(most, size - first);
      set({queries.data(), count}, first);
      for (std::size_t i = 0; i < count; ++i)
        answers[i].stamp = answers[i].newest = 0;  // not all lookups set them
      tree.lookup_batch({queries.data(), count}, {answers.data(), count});
      for (std::size_t i = 0; i < count && tree.ids_freed() != ids_freed_; ++i)
        look_up_row(tree, first + i, [&](const Query& q) { tree.lookup(q, answers[i]); });
      add(first, std::span<const Answer>(answers).first(count));
    }
  }
  // Looks up all rows at one instant. Sets `reads` to the frames that they rest
  // on. Throws Rejected if that are more than `max_reads`.
  template <class AnyTree>
  void look_up_at_once(const AnyTree& tree, std::span<Answer> answers, ReadSet& reads,
                       std::size_t max_reads = kNoReadLimit);
  // Looks up all rows at one instant, or each at one of its own. Returns each frame that they rest
  // on once, in the version that was read first: if a later row has read another one, the frame has
  // changed, and a transaction conflicts in any case. Throws Rejected if that are more than
  // `max_reads`.
  template <class AnyTree>
  std::vector<ReadVersion> look_up_with_versions(const AnyTree& tree, bool at_once,
                                                 std::span<Answer> answers, std::size_t max_reads);

 private:
  static constexpr std::size_t kRowsAtOnce = SampleBlock::kRows;

  // Sets the queries of the rows from `first` on, field by field in place: to copy a query that was
  // just written by smaller stores stalls the processor for a third of a lookup's time.
  void set(std::span<Query> queries, std::size_t first) const noexcept;
  // Finds those names of a row again that have lost their ids. Returns whether there are any.
  template <class AnyTree>
  bool find_lost_names(const AnyTree& tree, std::size_t row);

  std::vector<NameRef> refs_;    // of the names, as they were found last
  std::uint64_t ids_freed_ = 0;  // from before they were all found last
};

inline void LookupRows::set(std::span<Query> queries, std::size_t first) const noexcept {
  const auto [target, source, fixed] = std::tuple(this->target, this->source, this->fixed);
  const auto [op, stamp] = std::tuple(this->op, this->stamp);
  const NameRef* const refs = refs_.data();
  for (std::size_t i = 0; i < queries.size(); ++i) {
    Query& query = queries[i];
    const std::size_t row = first + i;
    const Op kind{op[row]};
    query.op = one_instant && kind == Op::latest ? Op::latest_xact : kind;
    query.target = refs[target[row]].id;
    query.source = refs[source[row]].id;
    query.stamp = stamp[row];
    query.max_gap = max_gap;
    if (kind != Op::full) continue;
    query.fixed = refs[fixed[row]].id;
    query.source_stamp = source_stamp[row];
  }
}

// The error of a row that failed. Its names may be such that no frame can have them.
template <class AnyTree>
Rejected row_error(const AnyTree& tree, const LookupRows& rows, std::size_t row,
                   const Failure& failure, LookupNote note) {
  if (std::optional<Rejected> fault = rows.fault(row)) return *std::move(fault);
  note.may_wait = rows.size == 1;
  return lookup_error(tree, failure, rows.named(row), note);
}

}  // namespace ztf
