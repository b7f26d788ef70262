// Places where a test build may lose the processor on purpose.
//
// With ZTF_YIELDS a thread yields now and then, by a seeded sequence, while it
// holds a lock or stands between reading and validating: interleavings that a
// quiet machine shows once a day then come many times a second. Empty otherwise.
#pragma once

#ifdef ZTF_YIELDS
#include <atomic>
#include <cstdint>
#include <thread>
#endif

namespace ztf {

#ifdef ZTF_YIELDS
inline std::atomic<std::uint64_t> yield_seed{1};

inline void yield_point() {
  thread_local std::uint64_t state =
      yield_seed.fetch_add(0x9E3779B97F4A7C15ull, std::memory_order_relaxed) | 1;
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  if (state % 64 == 0) std::this_thread::yield();
}
#else
inline void yield_point() noexcept {}
#endif

}  // namespace ztf
