#include "messages/put.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

#include "messages/cursor.hpp"

namespace ztf {

namespace {

constexpr std::size_t kNamesPerRow = 3;     // as Limits.check_names of the server
constexpr std::size_t kDecodedName = 64;    // at most what Python needs beside a name's text
constexpr std::size_t kDecodedRest = 1024;  // the same of the map, its keys and columns

// Columns are little-endian, and are copied as they are.
static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(Row) == 2 * sizeof(std::uint32_t) + sizeof(Stamp) + sizeof(Pose));

template <class T>
T entry(std::string_view column, std::size_t i) {
  T value;
  std::memcpy(&value, column.data() + i * sizeof(T), sizeof(T));
  return value;
}

}  // namespace

std::optional<std::vector<Row>> rows_of(const RowColumns& columns, std::size_t names) {
  const auto& [parents, children, stamps, poses] = columns;
  const std::size_t n = stamps.size() / sizeof(Stamp);
  if (stamps.size() != n * sizeof(Stamp) || parents.size() != n * sizeof(std::uint32_t) ||
      children.size() != n * sizeof(std::uint32_t) || poses.size() != n * sizeof(Pose))
    return {};
  std::vector<Row> rows(n);
  std::uint32_t highest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    rows[i] = {entry<std::uint32_t>(parents, i), entry<std::uint32_t>(children, i),
               entry<Stamp>(stamps, i), entry<Pose>(poses, i)};
    highest = std::max({highest, rows[i].parent, rows[i].child});
  }
  if (n != 0 && highest >= names) return {};
  return rows;
}

std::optional<PutMessage> parse_put(std::string_view message, const PutLimits& limits) {
  MessageCursor cursor(message);
  PutMessage put;
  RowColumns columns;
  struct Field {
    std::string_view key;
    std::string_view* column;
  };
  const Field fields[] = {{"v", nullptr},
                          {"names", nullptr},
                          {"parent", &columns.parent},
                          {"child", &columns.child},
                          {"stamp", &columns.stamp},
                          {"pose", &columns.pose}};
  if (!cursor.raw("\x86")) return {};  // a map of six
  unsigned found = 0;                  // a bit for each field
  for (std::size_t i = 0; i < std::size(fields); ++i) {
    std::string_view key;
    if (!cursor.text(key)) return {};
    const auto* const field = std::ranges::find(fields, key, &Field::key);
    const unsigned bit = 1u << (field - fields);
    if (field == std::end(fields) || (found & bit) != 0) return {};
    found |= bit;
    if (field->column ? !cursor.binary(*field->column)
        : key == "v"  ? !cursor.raw("\x01")
                      : !cursor.names(kNamesPerRow * limits.rows, put.names))
      return {};
  }
  if (!cursor.at_end()) return {};
  if (kDecodedRest + message.size() + put.names.size() * kDecodedName > limits.decoded_bytes)
    return {};
  if (columns.stamp.size() / sizeof(Stamp) > limits.rows) return {};
  auto rows = rows_of(columns, put.names.size());
  if (!rows) return {};
  put.rows = std::move(*rows);
  return put;
}

}  // namespace ztf
