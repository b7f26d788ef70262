// The loop of everything that is read optimistically, and a count of its failed attempts.
//
// With ZTF_COUNT_RETRIES each thread counts the failed attempts of its own lookups and commits.
// Without it, count_retry() is empty.
#pragma once

#include "base/compiler.hpp"

#ifdef ZTF_COUNT_RETRIES
#include <cstdint>
#endif

namespace ztf {

#ifdef ZTF_COUNT_RETRIES
inline thread_local std::uint64_t retries = 0;

inline void count_retry() noexcept { ++retries; }
#else
inline void count_retry() noexcept {}
#endif

// Runs attempt() until it returns true, as long as may_try() does. Returns whether it did.
template <class MayTry, class Attempt>
ZTF_ALWAYS_INLINE bool retry_while(MayTry&& may_try, Attempt&& attempt) {
  while (may_try()) {
    if (attempt()) [[likely]]
      return true;
    count_retry();
  }
  return false;
}

// The same, up to so many times.
template <class Attempt>
ZTF_ALWAYS_INLINE bool retry(int attempts, Attempt&& attempt) {
  return retry_while([&] { return attempts-- > 0; }, attempt);
}

}  // namespace ztf
