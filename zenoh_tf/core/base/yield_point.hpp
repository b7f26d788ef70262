// Places where a test build may lose the processor on purpose.
//
// With ZTF_YIELDS a thread sometimes yields at a yield point, by a seeded sequence. Yield points
// lie where a thread holds a lock, or stands between reading and validating, so that rare
// interleavings become frequent. A test may also set a hook. Without ZTF_YIELDS the function is
// empty.
//
// Thread safety: any thread. The hook belongs to the thread that sets it.
#pragma once

#ifdef ZTF_YIELDS
#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>
#endif

namespace ztf {

#ifdef ZTF_YIELDS
inline std::atomic<std::uint64_t> yield_seed{1};

// Called at each of this thread's yield points instead of the random yield, if set.
inline thread_local const std::function<void()>* yield_hook = nullptr;

inline void yield_point() {
  if (yield_hook) return (*yield_hook)();
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
