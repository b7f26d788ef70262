// Trees in shared regions for tests, and a region that a test may write to as it likes.
//
// Thread safety: as the tree's.
#pragma once

#include "fixture.hpp"
#include "shared/shared_tree.hpp"
#include "system/host.hpp"

namespace ztf {

using Reason = Unanswered::Reason;

constexpr std::int64_t kLong = 3'600'000'000'000;  // ns

inline Options shared(Options options = {}) {
  options.shared = true;
  options.max_frames = std::min(options.max_frames, 4096u);
  options.max_memory_bytes = 1 << 24;
  return options;
}

// Returns the reason why body() was not answered; nothing if it was.
template <class Body>
std::optional<Reason> unanswered(Body&& body) {
  try {
    body();
  } catch (const Unanswered& why) {
    return why.reason;
  }
  return std::nullopt;
}

inline std::string name_of(unsigned n) {
  return std::string(n % 3 == 0 ? 30 : 0, 'x') + nth("frame", n);
}

// A region that the test may write to as it likes.
struct Bare {
  explicit Bare(Options options = shared()) : region(options) {
    NameTable names(region.header().names, region.names(), options.max_frames, region);
    for (unsigned n = 0; n < 20; ++n) names.insert(name_of(n));
    const NameTable authorities(region.header().authorities, region.authorities(),
                                options.max_authorities, region);
    region.header().lease_ns = monotonic_ns() + kLong;
  }
  Region region;
};

}  // namespace ztf
