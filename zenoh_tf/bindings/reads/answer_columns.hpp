// Lookups as columns over a list of names, and their answers as columns: what read_rows.cpp,
// lookup_columns.cpp and parked_lookups.cpp share.
//
// Thread safety: everything here requires the GIL, except where it says "needs no GIL".
#pragma once

#include "bindings/reads/budget.hpp"
#include "by_name/rows.hpp"

namespace ztf {

// The columns of a lookup, as they were sent.
struct ReadColumns {
  // Checks that they have as many rows each.
  void check() const;
  // Sets the columns of the rows; this object keeps their arrays alive. Throws Rejected for a row
  // that is malformed. Needs no GIL.
  void set(LookupRows& rows) const;

  Column<std::uint8_t> op;
  Column<std::uint32_t> target, source;
  Column<Stamp> stamp;
  std::optional<Column<std::uint32_t>> fixed;
  std::optional<Column<Stamp>> source_stamp;
  Stamp max_gap;  // ns, of all rows, or kNoGapLimit
};

// How the failures of a reply are reported.
struct FailureReport {
  bool is_starting = false;  // the tree's server
  bool errors = true;        // false: only by their status, and there are no newest stamps
  Budget* budget = nullptr;  // beyond its `error_bytes`, rows that fail have only their status
  // Empty, or for each row how long it has waited, or why it could not.
  std::vector<std::string> notes = {};
};

// The answers as the columns of a reply. Poses of failed rows are NaN.
struct AnswerColumns {
  // Columns of `rows` rows, to be filled by `add`. Needs no GIL.
  AnswerColumns(std::size_t rows, const FailureReport& report);
  // Adds the answers to the rows from `first` on. Returns true if one has failed. Needs no GIL.
  bool add(const LookupRows& rows, std::size_t first, std::span<const Answer> answers);
  // The longest gaps, which the object then has no longer.
  nb::object take_gaps();

  struct Failed {
    std::size_t row;
    Failure failure;
  };
  std::size_t size;
  std::unique_ptr<std::uint8_t[]> status;
  std::unique_ptr<Stamp[]> stamp, newest;
  std::unique_ptr<Stamp[]> gap;  // null as long as no row has one
  std::unique_ptr<double[]> pose;
  std::vector<Failed> failed;  // the rows whose errors may have room in the reply

 private:
  std::size_t most_failed_;
  bool is_starting_;
};

// (status, stamps, newest stamps, poses, [(row, error)], reads, gaps or None).
template <class AnyTree>
nb::tuple reply(const AnyTree& tree, const LookupRows& rows, AnswerColumns&& columns,
                const FailureReport& report, const nb::object& reads);

}  // namespace ztf
