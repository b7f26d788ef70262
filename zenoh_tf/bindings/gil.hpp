// Calls into Python that may take the GIL back while the interpreter shuts down.
//
// Thread safety: any thread.
#pragma once

#if defined(__GLIBCXX__)
#include <cxxabi.h>
#include <chrono>
#include <thread>
#endif

namespace ztf {

// Runs `body`; never returns if Python ends this thread in it.
//
// At shutdown Python ends daemon threads that take the GIL, by unwinding their stacks. nanobind
// mistakes that for an exception of its own and aborts the process, so such a thread sleeps
// instead.
template <class Body>
void block_if_thread_ends(Body&& body) {
#if defined(__GLIBCXX__)
  try {
    body();
  } catch (abi::__forced_unwind&) {
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
  }
#else
  body();
#endif
}

}  // namespace ztf
