// Why the tree rejects a write.
//
// Thread safety: a value.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/code.hpp"
#include "base/stamp.hpp"

namespace ztf {

// Thrown if a commit or a removal is rejected: the reason, and the facts that it rests on. Facts
// that do not apply are empty, kNoStamp or -1.
struct Rejected {
  Code code;
  std::string message;
  std::string frame = {}, parent = {}, field = {};
  Stamp stamp = kNoStamp, oldest = kNoStamp, newest = kNoStamp;
  std::int64_t limit = -1, value = -1;
};

// A name in a message.
inline std::string quoted(std::string_view name) {
  return std::string("'").append(name).append("'");
}

}  // namespace ztf
