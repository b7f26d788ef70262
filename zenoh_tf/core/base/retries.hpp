// A count of failed attempts, for builds that measure it.
//
// With ZTF_COUNT_RETRIES each thread counts the failed attempts of its own lookups and commits.
// Retries of blocks of samples are not counted. Without ZTF_COUNT_RETRIES the function is empty.
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
