// Methods of a tree in another process, which may be unable to answer.
//
// Thread safety: everything here requires the GIL.
#pragma once

#include "bindings/bindings.hpp"

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

}  // namespace ztf
