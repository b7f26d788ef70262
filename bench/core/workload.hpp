// What is asked and set: frames with ten seconds of history, and the cases.
//
// Thread safety: values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "pose.hpp"

namespace bench {

using Stamp = std::int64_t;  // ns

constexpr Stamp kStart = 1'700'000'000'000'000'000;
constexpr Stamp kPeriod = 10'000'000;  // 100 Hz
constexpr int kSamples = 1000;         // ten seconds: as much as the cache keeps
constexpr Stamp kCache = kPeriod * kSamples;
constexpr unsigned kMaxThreads = 64;

struct Link {
  std::string parent, child;
  Stamp offset = 0;  // of its stamps
};

// A sample of a link. No rotation is the identity, none is around one axis.
ztf::Pose pose_of(std::size_t link, int sample);

// The links of the tree that both sides hold, and for each thread one to set.
std::vector<Link> links();
Link link_to_set(unsigned thread);

enum class Kind {
  common_ids,    // latest common time, ids resolved once
  common_names,  // the same, both names resolved in every call
  at_ids,        // a random time in mid-history, between two samples
  set,           // one transform; every set drops the oldest sample of a full history
};

struct Case {
  const char* name;
  Kind kind;
  std::string target, source;  // where it is a lookup
  double bar = 0;              // times tf2's rate that one thread must reach; 0: none
  double bar_of_two = 0;       // the same of two threads
};

std::vector<Case> cases();

// Random times in mid-history; a power of two of them, for a cheap index.
constexpr std::size_t kTimes = 4096;
const std::vector<Stamp>& times();

}  // namespace bench
