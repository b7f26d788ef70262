// What is compared: systems that hold a row of frames, and the requests that they are asked.
// C++17, because tf2 needs it.
//
// Thread safety: lookup() and write() from any thread; all else are values.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <istream>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "geometry/pose.hpp"

namespace bench {

using Stamp = std::int64_t;  // ns
using FrameIndex = std::uint32_t;
using Names = std::vector<std::string>;  // of all frames

constexpr Stamp kStart = 1'700'000'000'000'000'000;  // of every history
constexpr unsigned kMaxThreads = 64;

// A snake: `links` links in a row. Frame 0 is the root, and link i joins frame i to frame i - 1.
inline Names make_names(FrameIndex links) {
  Names names;
  for (FrameIndex i = 0; i <= links; ++i) names.push_back("link" + std::to_string(i));
  return names;
}
// A frame beside them, which changes its parent in some cases.
constexpr const char* kGrasped = "grasped";

// A link's transform at a time: every link turns and moves back and forth, none is the identity.
class Motion {
 public:
  // Each link turns by so many radians in a millisecond.
  explicit Motion(double rad_per_ms) {
    for (int i = 0; i < 16; ++i)
      for (int k = 0; k < 64; ++k) {
        const double half = 0.15 + 0.05 * i + rad_per_ms / 2 * k, sine = std::sin(half) / 7;
        const double axis[] = {2 * sine, 3 * sine, 6 * sine, 2 * sine, 3 * sine};
        const double *a = axis + i % 3, x = 0.5 + 0.25 * i, y = 0.001 * k - 1;
        table_[i][k] = {x, y, 0.125 * i, a[0], a[1], a[2], std::cos(half)};
      }
  }

  const ztf::Pose& operator()(FrameIndex link, Stamp stamp) const {
    const auto step = static_cast<unsigned>(stamp >> 20) % 128;  // about a millisecond each
    return table_[link % 16][step < 64 ? step : 127 - step];
  }

 private:
  std::array<std::array<ztf::Pose, 64>, 16> table_;
};

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

// Draws requests for `length` links in a row, at times in the middle half of the history.
struct Draw {
  FrameIndex frames, length;
  Stamp quarter;  // of the history's duration

  Request operator()(Random& random) const noexcept {
    const FrameIndex target = random.below(frames - length);
    const Stamp time = kStart + quarter + 2 * static_cast<Stamp>(random.below(quarter));
    return {target, target + length, time};
  }
};

enum class Read { latest_common, latest_common_by_name, latest_xact, at };

struct Reply {
  ztf::Pose pose;
  Stamp stamp = 0;  // the oldest used
};

// NAME=VALUE words. Getting one that is missing, or no number, throws std::exception.
struct Settings : std::map<std::string, std::string> {
  explicit Settings(std::istream& words) {
    for (std::string word; words >> word;)
      (*this)[word.substr(0, word.find('='))] = word.substr(word.find('=') + 1);
  }
  [[nodiscard]] double number(const std::string& name) const { return std::stod(at(name)); }
  [[nodiscard]] unsigned count(const std::string& name) const {
    return static_cast<unsigned>(std::stoul(at(name)));
  }
};

class System {
 public:
  virtual ~System() = default;

  [[nodiscard]] virtual bool has_transactions() const = 0;

  // Requires that every link was written; must be called before the first lookup.
  virtual void resolve_ids() {}

  // Looks up `count` requests one by one, by ids where the system has ids. Returns how many found a
  // transform; `last` is the last of these.
  virtual unsigned lookup(Read read, const Request* requests, unsigned count, Reply& last) = 0;

  // Sets `links` links in a row from `first` on, by names; in one transaction where the system has
  // transactions. Returns how many it stored.
  virtual unsigned write(FrameIndex first, unsigned links, Stamp stamp) = 0;

  // Makes kGrasped a child of the root, and at a later stamp of the last frame.
  virtual void grasp(Stamp stamp) = 0;
};

// Settings: cache_s, how far history reaches back; max_samples of a link, which tf2 does not limit;
// child_to_parent, the order in which links are written; rad_per_ms, see Motion; and for the tree
// `system`, its concurrency control: "optimistic", "2pl" or "giant". The names must outlive the
// system.
std::unique_ptr<System> make_tree_system(const Names& names, const Settings& settings);
std::unique_ptr<System> make_tf2_system(const Names& names, const Settings& settings);

// Keeps a result from being optimised away.
inline void keep(const double& value) { asm volatile("" : : "m"(value) : "memory"); }

}  // namespace bench
