// The names of a message, each once, and columns of indexes into them.
#pragma once

#include <unordered_map>

#include "bindings/bindings.hpp"
#include "by_name/rows.hpp"

namespace ztf {

// In the order of their first use.
class MessageNames {
 public:
  std::uint32_t index_of(nb::handle name, const char* field = "frame") {
    const std::string_view text = text_of(name, field);
    const auto [at, is_new] = known_.try_emplace(text, static_cast<std::uint32_t>(texts_.size()));
    if (is_new) {
      list_.append(name);
      texts_.push_back(text);
    }
    return at->second;
  }
  [[nodiscard]] const nb::list& list() const { return list_; }
  [[nodiscard]] const std::vector<std::string_view>& texts() const { return texts_; }

 private:
  nb::list list_;  // keeps the texts alive
  std::vector<std::string_view> texts_;
  std::unordered_map<std::string_view, std::uint32_t> known_;
};

// Indexes of the names of frames: of one name for all rows, or of a sequence of names.
class NameColumn {
 public:
  NameColumn(MessageNames& names, nb::handle given, const char* field)
      : is_single_(PyUnicode_Check(given.ptr())) {
    if (is_single_) {
      indexes_.push_back(names.index_of(given, field));
      return;
    }
    const nb::tuple items = nb::steal<nb::tuple>(PySequence_Tuple(given.ptr()));
    if (!items.is_valid()) {
      PyErr_Clear();
      raise_invalid(std::string(field) + " must be a name or a sequence of names", field);
    }
    indexes_.reserve(items.size());
    // Often one str object is repeated many times in a row.
    const PyObject* last = nullptr;
    for (const nb::handle item : items) {
      indexes_.push_back(item.ptr() == last ? indexes_.back() : names.index_of(item, field));
      last = item.ptr();
    }
  }
  [[nodiscard]] bool is_single() const noexcept { return is_single_; }
  [[nodiscard]] std::size_t size() const noexcept { return indexes_.size(); }
  [[nodiscard]] const std::vector<std::uint32_t>& indexes() const noexcept { return indexes_; }
  [[nodiscard]] RowValues<std::uint32_t> values() const noexcept {
    return {indexes_.data(), is_single_};
  }

 private:
  const bool is_single_;
  std::vector<std::uint32_t> indexes_;
};

}  // namespace ztf
