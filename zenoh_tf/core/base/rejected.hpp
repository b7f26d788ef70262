// Why the tree rejects a write, or has no answer.
//
// Thread safety: a value.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/code.hpp"
#include "base/stamp.hpp"

namespace ztf {

// The reason, and the facts that it rests on. Facts that do not apply are empty, kNoStamp or -1.
// Thrown if a commit or a removal is rejected.
struct Rejected {
  Code code;
  std::string message;
  std::string frame = {}, parent = {}, field = {};
  Stamp stamp = kNoStamp, oldest = kNoStamp, newest = kNoStamp;
  std::int64_t limit = -1, value = -1;
  // Of a lookup.
  std::string target = {}, source = {}, target_root = {}, source_root = {};
  Stamp gap = -1, max_gap = -1;  // ns, between two samples; the limit of it
  double retry_after_s = -1;     // when to ask a server again that has just started
};

// A name in a message.
inline std::string quoted(std::string_view name) {
  return std::string("'").append(name).append("'");
}

// Throws Rejected unless the index is below the size of the list that it refers to.
inline void check_index(std::uint32_t index, std::size_t size, const char* field) {
  if (index >= size) [[unlikely]]
    throw Rejected{.code = Code::invalid_argument,
                   .message = std::string(field) + " has the index " + std::to_string(index) +
                              ", but its list has " + std::to_string(size) + " entries",
                   .field = field};
}

}  // namespace ztf
