// Which host and which clock this process has: what two processes must share to compare times.
//
// Thread safety: every function, from any thread.
#pragma once

#include <time.h>

#include <cstdint>
#include <cstdio>
#include <string>

#if defined(__linux__)
#include <sys/stat.h>
#include <unistd.h>
#endif

namespace ztf {

// Identifies the host's boot; empty if the system does not say. Throws bad_alloc.
inline std::string boot_id() {
  char text[37] = {};
  if (std::FILE* const file = std::fopen("/proc/sys/kernel/random/boot_id", "r")) {
    (void)!std::fgets(text, sizeof text, file);
    std::fclose(file);
  }
  return text;
}

// Identifies the time namespace, in which CLOCK_MONOTONIC may have an offset; 0 if the system does
// not say.
inline std::uint64_t time_namespace() noexcept {
#if defined(__linux__)
  struct stat status{};
  if (::stat("/proc/self/ns/time", &status) == 0) return status.st_ino;
#endif
  return 0;
}

// 0 if the system does not say.
inline std::uint64_t physical_memory_bytes() noexcept {
#if defined(__linux__)
  return static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) *
         static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
#else
  return 0;
#endif
}

inline std::int64_t clock_ns(clockid_t clock) noexcept {
  timespec time{};
  (void)::clock_gettime(clock, &time);
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}
// Nanoseconds since 1970.
inline std::int64_t real_time_ns() noexcept { return clock_ns(CLOCK_REALTIME); }
inline std::int64_t monotonic_ns() noexcept { return clock_ns(CLOCK_MONOTONIC); }
// The same clock, some milliseconds late and several times as fast to read where the system has it.
inline std::int64_t coarse_monotonic_ns() noexcept {
#if defined(CLOCK_MONOTONIC_COARSE)
  return clock_ns(CLOCK_MONOTONIC_COARSE);
#else
  return monotonic_ns();
#endif
}

}  // namespace ztf
