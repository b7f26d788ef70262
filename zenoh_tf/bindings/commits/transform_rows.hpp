// TransformRows: transforms as columns, from a message to the commit.
#pragma once

#include <span>

#include "bindings/bindings.hpp"
#include "messages/put.hpp"

namespace ztf {

// Names, each once, and rows that refer to them. Never changes, so that rows and texts may be read
// without the GIL.
class TransformRows {
 public:
  TransformRows(nb::list names, std::vector<Row> rows);
  // Of a message, which `owner` keeps alive. The texts point into it, and must be UTF-8.
  TransformRows(nb::object owner, std::vector<std::string_view> texts, std::vector<Row> rows);

  // Both make the names of a message when they are asked for: a commit needs only their texts.
  [[nodiscard]] nb::list names() const;
  // The same, which Python cannot change.
  [[nodiscard]] nb::tuple kept_names() const;
  // The names' UTF-8.
  [[nodiscard]] std::span<const std::string_view> texts() const noexcept { return texts_; }
  [[nodiscard]] std::span<const Row> rows() const noexcept { return rows_; }

 private:
  void make_names() const;

  mutable nb::object names_;  // list, which Python may change; null: not made yet
  mutable nb::object kept_;   // tuple; null: not made yet
  nb::object owner_;          // with the names it keeps the texts alive
  std::vector<std::string_view> texts_;
  std::vector<Row> rows_;
};

}  // namespace ztf
