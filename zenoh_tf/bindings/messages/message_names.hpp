// The names of a message, each once.
#pragma once

#include <unordered_map>

#include "bindings/bindings.hpp"

namespace ztf {

// In the order of their first use.
class MessageNames {
 public:
  std::uint32_t index_of(nb::handle name) {
    const auto [at, is_new] =
        known_.try_emplace(text_of(name, "frame"), static_cast<std::uint32_t>(known_.size()));
    if (is_new) list_.append(name);
    return at->second;
  }
  [[nodiscard]] const nb::list& list() const { return list_; }

 private:
  nb::list list_;  // keeps the texts alive
  std::unordered_map<std::string_view, std::uint32_t> known_;
};

}  // namespace ztf
