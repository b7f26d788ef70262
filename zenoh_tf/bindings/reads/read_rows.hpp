// Lookups and commits as columns over a list of names: shared by read_rows.cpp, answer_columns.cpp,
// commit.cpp and parked_lookups.cpp. The first two compile the templates for both kinds of trees.
//
// Thread safety: everything here requires the GIL, except where it says "needs no GIL".
#pragma once

#include "bindings/reads/budget.hpp"

namespace ztf {

// Fills `texts` with the UTF-8 of the names. Returns the names, which keep the texts alive. Raises
// LimitExceeded for a name that is too long for the tree, and quotes only its beginning.
template <class AnyTree>
std::vector<nb::object> names_of(const AnyTree& tree, nb::handle names,
                                 std::vector<std::string_view>& texts, const char* field);
// Raises LimitExceeded for a name that is too long for the tree, and quotes only its beginning.
template <class AnyTree>
void check_name_bytes(const AnyTree& tree, std::span<const std::string_view> names);

// The columns of a lookup, as they were sent.
struct ReadColumns {
  const Column<std::uint8_t>& op;
  const Column<std::uint32_t>&target, &source;
  const Column<Stamp>& stamp;
  const std::optional<Column<std::uint32_t>>& fixed;
  const std::optional<Column<Stamp>>& source_stamp;
  Stamp max_gap;  // ns, of all rows, or kNoGapLimit
};

// One lookup per row.
struct ReadRows {
  // Resolves the names, and checks that the columns have as many rows each; `set` adds the rows.
  template <class AnyTree>
  ReadRows(const AnyTree& tree, nb::handle names, const ReadColumns& columns);

  // Adds the rows. Throws Rejected for a row that is malformed. Needs no GIL.
  void set(const ReadColumns& columns);

  struct Names {  // indexes into the names
    std::uint32_t target, source, fixed;
  };
  std::vector<std::string_view> texts;   // point into name_objects
  std::vector<nb::object> name_objects;  // str
  std::vector<FrameRef> frames;          // as the names were found last
  std::vector<bool> invalid_name;        // no frame can have it
  std::vector<Names> names;
  std::vector<Query> queries;

  // Finds all names again and updates the queries. Returns true if every name still has the id
  // that the queries used: otherwise their answers may be another frame's, or from before a frame
  // was created. Needs no GIL.
  template <class AnyTree>
  [[nodiscard]] bool find_names_again(const AnyTree& tree);
  // Calls look_up(query) for one row, again if a name of it has lost its id meanwhile. Needs no
  // GIL, unless look_up does.
  template <class AnyTree, class LookUp>
  void look_up_row(const AnyTree& tree, std::size_t row, LookUp&& look_up) {
    do {
      set_query_ids(row);
      look_up(queries[row]);
    } while (!find_lost_names(tree, row));
  }

  // The links that the rows climb at most, by the newest parents; if that is more than `most`, any
  // number above it. Costs a walk for each name that a row uses. Needs no GIL.
  template <class AnyTree>
  [[nodiscard]] std::uint64_t links(const AnyTree& tree, std::uint64_t most) const;

  // Needs no GIL.
  [[nodiscard]] bool has_invalid_name(std::size_t row) const;
  // The error of a row that has an invalid name.
  template <class AnyTree>
  [[nodiscard]] nb::object name_error(const AnyTree& tree, std::size_t row) const;

 private:
  void set_query_ids();
  void set_query_ids(std::size_t row);
  // Finds those names of a row again that have lost their ids. Returns true if there are none.
  template <class AnyTree>
  bool find_lost_names(const AnyTree& tree, std::size_t row);
};

// How the failures of a reply are reported.
struct FailureReport {
  // Empty, or for each row how long it has waited, or why it could not.
  const std::vector<std::string>& notes;
  bool is_starting = false;  // the tree's server
  bool errors = true;        // false: only by their status
  Budget* budget = nullptr;  // beyond its `error_bytes`, rows that fail have only their status
};

// The answers as the columns of a reply. Poses of failed rows are NaN.
struct AnswerColumns {
  // Columns of `rows` rows, to be filled by `add`. Needs no GIL.
  AnswerColumns(std::size_t rows, const FailureReport& report);
  // Adds the answers to the rows from `first` on. Returns true if one has failed. Needs no GIL.
  bool add(const ReadRows& rows, std::size_t first, std::span<const Answer> answers);

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
nb::tuple reply(const AnyTree& tree, const ReadRows& rows, AnswerColumns&& columns,
                const FailureReport& report, const nb::object& reads);

}  // namespace ztf
