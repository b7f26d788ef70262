// The message of a put as rows.
//
// A message is parsed here if it has the fields of a put and no others, in any order. The general
// decoder (zenoh_tf/wire/commit.py) takes all others, and says what is wrong with them.
//
// Thread safety: functions of their arguments.
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "commits/request.hpp"

namespace ztf {

// The columns of a message, little-endian.
struct RowColumns {
  std::string_view parent, child, stamp, pose;
};
// The rows of columns that refer to `names` names; nullopt if they are malformed.
std::optional<std::vector<Row>> rows_of(const RowColumns& columns, std::size_t names);

struct PutMessage {
  std::vector<std::string_view> names;  // views of the message, in UTF-8
  std::vector<Row> rows;
};
struct PutLimits {
  std::size_t rows, decoded_bytes;
};
// Nullopt if the message is of another form, or beyond a limit. Reserves memory only within the
// limits. Throws bad_alloc.
std::optional<PutMessage> parse_put(std::string_view message, const PutLimits& limits);

}  // namespace ztf
