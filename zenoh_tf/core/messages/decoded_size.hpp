// What a MessagePack message will cost before it is decoded.
//
// A byte of a message may become a Python object of 100 bytes, and the head of a list claims memory
// for its entries before they are there. So the decoder runs only on messages that passed.
//
// Thread safety: a function of its arguments.
#pragma once

#include <cstdint>
#include <string_view>

namespace ztf {

constexpr std::int64_t kMalformed = -1;
constexpr std::int64_t kTooDeep = -2;

// The bytes that the decoded message takes in CPython; kMalformed or kTooDeep.
std::int64_t decoded_size(std::string_view message);

}  // namespace ztf
