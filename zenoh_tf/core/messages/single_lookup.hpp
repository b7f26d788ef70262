// The messages of a lookup of one row, whose packing and parsing would cost more than the lookup.
//
// docs/reference/protocol.md, "lookup", says what they mean. A message may have its fields in any
// order and more of them, so only those are parsed here that are byte for byte as this file, and
// the Python side, write them: without optional fields, and in one order. The general decoder reads
// all others (zenoh_tf/wire/lookup.py), and says what is wrong with them.
//
// Thread safety: functions of their arguments.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "geometry/pose.hpp"
#include "reads/query.hpp"

namespace ztf {

// The request. The names are views of the message, and may not be valid UTF-8.
struct SingleLookup {
  std::string_view target, source;
  Op op;
  Stamp stamp;  // kNoStamp: none is given
};

// The reply of a lookup that has an answer.
struct SingleAnswer {
  Stamp stamp;
  std::optional<Stamp> newest;  // of `latest` and `latest_xact`
  Pose pose;
};

// Of a name, as servers allow by default, and of an instance.
constexpr std::size_t kMaxSingleText = 255;

// Nullopt if a name is longer.
std::optional<std::string> pack_single_lookup(const SingleLookup& lookup);
// Nullopt for any other message.
std::optional<SingleLookup> parse_single_lookup(std::string_view message);

// `instance`: of the server that answers. Nullopt if it is longer.
std::optional<std::string> pack_single_answer(const SingleAnswer& answer,
                                              std::string_view instance);
// Nullopt for any other message, and for the reply of another server instance.
std::optional<SingleAnswer> parse_single_answer(std::string_view message,
                                                std::string_view instance);

}  // namespace ztf
