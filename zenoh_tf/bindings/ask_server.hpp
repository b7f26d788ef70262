// Methods of a tree in another process, which may be unable to answer.
//
// Thread safety: everything here requires the GIL.
#pragma once

#include <algorithm>

#include "bindings.hpp"

namespace ztf {

template <auto function>
struct OrAskServer;
template <class Result, class... Args, Result (*function)(Args...)>
struct OrAskServer<function> {
  static nb::object call(Args... args) {
    try {
      return nb::cast(function(args...));
    } catch (const Unanswered& unanswered) {
      return nb::cast(unanswered.reason);
    }
  }
};
// The function, with a member of AskServer as its result if it throws Unanswered.
template <auto function>
constexpr auto* or_ask_server = &OrAskServer<function>::call;

// A shared tree, and what to call for an answer that it does not have. Its lookups are the methods
// of a client with the same names, so a client can put them in the place of its own: a Python
// function in between would take half as long as the lookup itself.
struct SharedLookups {
  const SharedTree& tree;
  nb::object ask;  // called with the method's name, a member of AskServer, and the arguments
};

void bind_lookups(nb::class_<SharedLookups>& lookups);

template <std::size_t size>
struct MethodName {
  consteval MethodName(const char (&name)[size]) { std::copy_n(name, size, text); }
  char text[size];
};

template <auto function, MethodName name>
struct OrCallAsk;
template <class Result, class... Args, Result (*function)(const SharedTree&, Args...),
          MethodName name>
struct OrCallAsk<function, name> {
  static nb::object call(const SharedLookups& lookups, Args... args) {
    Unanswered::Reason reason;
    try {
      return nb::cast(function(lookups.tree, args...));
    } catch (const Unanswered& unanswered) {
      reason = unanswered.reason;
    }
    return lookups.ask(name.text, reason, args...);
  }
};
// The function of a tree as a method of SharedLookups.
template <auto function, MethodName name>
constexpr auto* or_call_ask = &OrCallAsk<function, name>::call;

}  // namespace ztf
