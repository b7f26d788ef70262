// TransformRows: transforms as columns, from a message to the commit.
#pragma once

#include <span>

#include "bindings/bindings.hpp"

namespace ztf {

// Names, each once, and rows that refer to them. Never changes, so that rows and texts may be read
// without the GIL.
class TransformRows {
 public:
  TransformRows(nb::list names, std::vector<Row> rows);

  [[nodiscard]] const nb::list& names() const noexcept { return names_; }
  // The same, which Python cannot change.
  [[nodiscard]] const nb::tuple& kept_names() const noexcept { return kept_; }
  // The names' UTF-8.
  [[nodiscard]] std::span<const std::string_view> texts() const noexcept { return texts_; }
  [[nodiscard]] std::span<const Row> rows() const noexcept { return rows_; }

 private:
  nb::list names_;  // Python may change it
  nb::tuple kept_;  // keeps the texts alive
  std::vector<std::string_view> texts_;
  std::vector<Row> rows_;
};

}  // namespace ztf
