// How often a call has started over, for builds that measure it.
//
// With ZTF_COUNT_RETRIES every thread counts the attempts of its lookups and commits that were in
// vain, but not of blocks of samples. Empty otherwise.
#pragma once

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

}  // namespace ztf
