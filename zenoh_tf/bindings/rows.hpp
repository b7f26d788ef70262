// Columns of rows: what the binding files that take or give them share.
//
// Thread safety: everything here needs the interpreter lock.
#pragma once

#include "bindings.hpp"

namespace ztf {

// The texts of a sequence of names, and the names, which keep the texts alive.
std::vector<nb::object> names_of(nb::handle names, std::vector<std::string_view>& texts,
                                 const char* field);
// An index into so many names, or an error.
std::uint32_t checked(std::uint32_t index, std::size_t names, const char* field);

template <class T>
void fit(const Column<T>& column, std::size_t n, const char* field) {
  if (column.shape(0) != n)
    raise_invalid(std::string(field) + " has " + std::to_string(column.shape(0)) + " rows, not " +
                      std::to_string(n),
                  field);
}

// Lookups, one per row.
struct ReadRows {
  ReadRows(const Tree& tree, nb::handle names, const Column<std::uint8_t>& op,
           const Column<std::uint32_t>& target, const Column<std::uint32_t>& source,
           const Column<Stamp>& stamp, const std::optional<Column<std::uint32_t>>& fixed,
           const std::optional<Column<Stamp>>& source_stamp);

  struct Names {  // rows of the names
    std::uint32_t target, source, fixed;
  };
  std::vector<std::string_view> texts;
  std::vector<nb::object> held;  // the names
  std::vector<FrameId> ids;      // 0 where there is no such frame
  std::vector<bool> bad_name;    // it can be no frame's
  std::vector<Names> names;
  std::vector<Query> queries;

  // Whether the names still are the frames that they were when the queries were answered: a new
  // frame may have come with other things that were read. If not, the queries are of the new ones.
  [[nodiscard]] bool names_stand(const Tree& tree);

  // Whether a row's names can be frames', and why not.
  [[nodiscard]] bool has_bad_name(std::size_t row) const;
  [[nodiscard]] nb::object name_error(const Tree& tree, std::size_t row) const;

 private:
  void use_ids();
};

// (status, stamps, newest stamps, poses, [(row, error)], reads); poses of rows
// that failed become the identity. `notes`: what is added to a row's message.
nb::tuple reply(const Tree& tree, const ReadRows& rows, std::vector<Answer>& answers,
                const std::vector<std::string>& notes, const nb::object& reads);

nb::object status_column(const std::vector<Answer>& answers);
nb::object stamp_column(const std::vector<Answer>& answers, Stamp Answer::* member);
nb::object pose_column(const std::vector<Answer>& answers);

}  // namespace ztf
