// What the systems under test hold and are asked: trees of frames, and random requests.
//
// Thread safety: values; every thread draws with a Random of its own.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "pose.hpp"

namespace bench {

using Stamp = std::int64_t;  // ns
using FrameIndex = std::uint32_t;

constexpr Stamp kStart = 1'700'000'000'000'000'000;  // of every history
constexpr unsigned kMaxThreads = 64;

// A link is named by its child frame. Parents come before their children; frame 0 is the root.
struct Forest {
  std::vector<std::string> names{"root"};
  std::vector<FrameIndex> parents{0};
  std::vector<Stamp> offsets{0};  // added to the stamps of the link's history

  [[nodiscard]] FrameIndex size() const { return static_cast<FrameIndex>(names.size()); }
  // Throws std::out_of_range if there is no such frame.
  [[nodiscard]] FrameIndex find(const std::string& name) const {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) throw std::out_of_range("no frame " + name);
    return static_cast<FrameIndex>(found - names.begin());
  }
  // Adds `count` links in a row below `top`, named PREFIX0, PREFIX1, ...; returns the last.
  FrameIndex add_chain(FrameIndex top, const std::string& prefix, unsigned count, Stamp step = 0) {
    for (unsigned i = 0; i < count; ++i) {
      names.push_back(prefix + std::to_string(i));
      parents.push_back(top);
      offsets.push_back(step * i);
      top = size() - 1;
    }
    return top;
  }
};

// "LINKS": a snake, that many links in a row. "chains": short ones, and links for single sets.
inline Forest make_forest(const std::string& shape) {
  Forest forest;
  if (shape != "chains") {
    forest.add_chain(0, "link", static_cast<unsigned>(std::stoul(shape)));
    return forest;
  }
  forest.add_chain(0, "link", 4);
  forest.add_chain(0, "staggered", 4, 2'000'000);
  for (const char* arm : {"left", "right"}) forest.add_chain(0, arm, 2);
  for (unsigned i = 0; i < kMaxThreads; ++i) forest.add_chain(0, "set_" + std::to_string(i), 1);
  return forest;
}

// A link's transform at a time. Every link turns and moves back and forth in small steps; none is
// the identity.
inline const ztf::Pose& pose_at(FrameIndex link, Stamp stamp) {
  constexpr int kClasses = 16, kSteps = 64;
  static const auto table = [] {
    std::array<std::array<ztf::Pose, kSteps>, kClasses> result;
    const double axis[3] = {2.0 / 7, 3.0 / 7, 6.0 / 7};
    for (int i = 0; i < kClasses; ++i)
      for (int k = 0; k < kSteps; ++k) {
        const double half = (0.3 + 0.1 * i + 0.002 * k) / 2, sine = std::sin(half);
        result[i][k] = {0.5 + 0.25 * i,     -1.0 + 0.001 * k,         0.125 * (i % 3),
                        axis[i % 3] * sine, axis[(i + 1) % 3] * sine, axis[(i + 2) % 3] * sine,
                        std::cos(half)};
      }
    return result;
  }();
  const auto step = static_cast<int>((stamp >> 20) & (2 * kSteps - 1));  // about a millisecond each
  return table[link % kClasses][step < kSteps ? step : 2 * kSteps - 1 - step];
}

class Random {  // xorshift64
 public:
  explicit Random(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ull | 1) {}
  // Uniform in [0, end); end is at most 2^32.
  FrameIndex below(std::uint64_t end) noexcept {
    state_ ^= state_ << 13;
    state_ ^= state_ >> 7;
    state_ ^= state_ << 17;
    return static_cast<FrameIndex>((state_ >> 32) * end >> 32);
  }

 private:
  std::uint64_t state_;
};

struct Request {
  FrameIndex target, source;
  Stamp time = 0;  // for lookups at a time
};

// Draws requests for `length` links of a snake in a row, or always for the same frames; times lie
// in the middle half of the history.
struct Draw {
  FrameIndex frames, length;
  Stamp quarter;    // of the history's duration
  Request fixed{};  // if its source is not the root

  Request operator()(Random& random) const noexcept {
    Request request = fixed;
    if (fixed.source == 0) {
      request.target = random.below(frames - length);
      request.source = request.target + length;
    }
    request.time = kStart + quarter + 2 * static_cast<Stamp>(random.below(quarter));
    return request;
  }
};

}  // namespace bench
