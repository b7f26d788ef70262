// Why a lookup by names has no answer, as a text and its facts.
//
// Thread safety: every function, from any thread.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/options.hpp"
#include "base/rejected.hpp"
#include "by_name/lookup.hpp"

namespace ztf {

// What an error says of how its lookup was asked.
struct LookupNote {
  std::string waited = {};  // as of waited_for(); empty if the lookup did not wait
  Stamp max_by = -1;        // of an estimate: how far links may be carried on, in nanoseconds
  bool may_wait = false;    // the method has a `timeout_s`
  bool suggest = true;      // the names that may be meant by one that does not exist
};

// "waited for 1.5 s"
std::string waited_for(double timeout_s);

// Why no frame can have that name; nullopt if one can. `field` names the argument.
std::optional<Rejected> name_fault(std::string_view name, const char* field);
// Throws Rejected for a name that is too long for the tree, of which it quotes the beginning.
void check_name_bytes(const Options& options, std::span<const std::string_view> names);

// True if the lookup failed because a frame does not exist.
inline bool is_unknown(const Failure& failure) noexcept {
  return failure.code == Code::lookup && failure.frame == 0;
}
// A failure's code, in a tree whose server is just starting or not.
inline Code shown_code(const Failure& failure, bool is_starting) noexcept {
  return is_unknown(failure) && is_starting ? Code::starting : failure.code;
}

// The error of a frame that is not there, which may be because its server has just started.
template <class AnyTree>
Rejected unknown_frame(const AnyTree& tree, std::string_view name);
// The error of a lookup of `source` in `target`. `latest`: at the latest common time.
template <class AnyTree>
Rejected lookup_error(const AnyTree& tree, const Failure& failure, std::string_view target,
                      std::string_view source, const LookupNote& note = {}, bool latest = false);
// The same of a query.
template <class AnyTree>
Rejected lookup_error(const AnyTree& tree, const Failure& failure, const NamedQuery& query,
                      const LookupNote& note = {});

// A question such as "; did you mean 'base_link'?", to be appended to an error; empty if all names
// are frames, or no frame's name is like one.
template <class AnyTree>
std::string suggestion(const AnyTree& tree, std::initializer_list<std::string_view> names);

}  // namespace ztf
