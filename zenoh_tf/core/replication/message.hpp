// Changes and frames as messages: a MessagePack map of two lists of texts, and a binary for each
// column (docs/reference/protocol.md, "stream"). In a message that begins at a multiple of 8, all
// columns do, so that they are read where they are.
//
// Thread safety: functions of their arguments.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/options.hpp"
#include "replication/columns.hpp"

namespace ztf {

// Throw bad_alloc.
std::string pack(const ChangeColumns& changes);
std::string pack(const FrameColumns& frames);

// The columns of a message: views of it, or copies where it is not aligned.
template <class Columns>
struct Received {
  Columns columns;
  std::vector<std::string_view> names, authorities;
  std::vector<std::unique_ptr<std::byte[]>> values;
};
// The columns have fitting lengths, and no index beyond its list. Throw Rejected, of
// Code::protocol, and bad_alloc.
Received<ChangeColumns> parse_changes(std::string_view message);
Received<FrameColumns> parse_frames(std::string_view message);

// Throw Rejected unless a tree with these options can have the columns' names, versions and
// samples.
void check_replayable(const ChangeColumns& changes, const Options& options);
void check_replayable(const FrameColumns& frames, const Options& options);

}  // namespace ztf
