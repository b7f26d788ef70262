// The fields of a MessagePack map that another process has sent. What is malformed is not there.
//
// Thread safety: values.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace ztf {

class MessageMap {
 public:
  // The bytes must outlive the map.
  explicit MessageMap(std::string_view bytes) : bytes_(bytes) {}

  // The bytes are a map.
  [[nodiscard]] bool is_map() const;
  [[nodiscard]] bool has(std::string_view name) const { return field(name).has_value(); }
  [[nodiscard]] std::optional<std::string_view> text(std::string_view name) const;
  [[nodiscard]] std::optional<std::string_view> binary(std::string_view name) const;
  [[nodiscard]] std::optional<std::int64_t> integer(std::string_view name) const;
  // A number of any kind.
  [[nodiscard]] std::optional<double> real(std::string_view name) const;
  // A map that is a field; an empty one if there is none.
  [[nodiscard]] MessageMap map(std::string_view name) const {
    return MessageMap(field(name).value_or("\x80"));
  }

 private:
  // The bytes of a value.
  [[nodiscard]] std::optional<std::string_view> field(std::string_view name) const;

  std::string_view bytes_;
};

}  // namespace ztf
