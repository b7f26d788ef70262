// How often a call has started over, for builds that measure it.
//
// With ZTF_COUNT_RESTARTS every thread counts the attempts of its lookups and commits that were in
// vain, but not of blocks of samples. Empty otherwise.
#pragma once

#ifdef ZTF_COUNT_RESTARTS
#include <cstdint>
#endif

namespace ztf {

#ifdef ZTF_COUNT_RESTARTS
inline thread_local std::uint64_t restarts = 0;

inline void count_restart() noexcept { ++restarts; }
#else
inline void count_restart() noexcept {}
#endif

}  // namespace ztf
