// What a caller asks of a commit, and what the commit did with each row.
//
// Thread safety: values.
#pragma once

#include <limits>
#include <span>
#include <string_view>

#include "records/frame.hpp"
#include "tree_state.hpp"

namespace ztf {

// The expiry of a write that may be applied at any time.
inline constexpr std::int64_t kNeverExpires = std::numeric_limits<std::int64_t>::max();

// One transform to be written. parent and child are indices into CommitRequest::names, or its
// frames, and less than its size.
struct Row {
  std::uint32_t parent, child;
  Stamp stamp;
  Pose pose;
};

struct CommitRequest {
  std::span<const std::string_view> names;
  std::span<const Row> rows;
  // In the place of `names`, which is then empty: names that were found before. The commit is
  // rejected with Code::stale_frame if one of them was removed since, and never gives a frame
  // another parent.
  std::span<const NameRef> frames = {};
  std::string_view authority = {};
  bool is_static = false;
  // Drops rows that are too old, older than all samples of a full frame, or, despite the name,
  // later than `max_stamp`. Without it, one such row rejects the commit.
  bool drop_old = false;
  // Refuses rows that are bad, each by itself (RowResult), and stores the others. Without it, one
  // such row rejects the commit.
  bool drop_bad = false;
  // With `drop_bad`, refuses dynamic rows far ahead of their frame's history, unless more of them
  // follow (commits/time_jumps.cpp). For samples in the order of their arrival.
  bool drop_strays = false;
  // The read set: the commit is rejected unless every frame still has the version that was read.
  // Version 0 asserts that the frame does not exist. read_names and read_versions are equally long.
  std::span<const std::string_view> read_names = {};
  std::span<const Version> read_versions = {};
  // The commit is rejected if it would be applied at this time of CLOCK_MONOTONIC or later. The
  // clock is read once nothing is left to wait for.
  std::int64_t expires_ns = kNeverExpires;
  // A dynamic row with a later stamp rejects the commit. With `drop_old` the row is dropped, as if
  // it were not there: it adds no name.
  Stamp max_stamp = std::numeric_limits<Stamp>::max();
};

// What a commit did with a row.
struct RowResult {
  static constexpr std::uint8_t dropped = 0;  // too old, or older than all of a full frame
  static constexpr std::uint8_t stored = 1;
  static constexpr std::uint8_t from_future = 2;  // dropped: later than CommitRequest::max_stamp
  // Refused (CommitRequest::drop_bad). Python has the same numbers (zenoh_tf/admission.py).
  static constexpr std::uint8_t not_finite = 3;    // a number of the pose is NaN or infinite
  static constexpr std::uint8_t bad_rotation = 4;  // the quaternion is not of length 1
  static constexpr std::uint8_t empty_name = 5;
  static constexpr std::uint8_t long_name = 6;
  static constexpr std::uint8_t own_parent = 7;  // child and parent are one frame
  static constexpr std::uint8_t bad_stamp = 8;   // kNoStamp
  static constexpr std::uint8_t other_authority = 9;
  static constexpr std::uint8_t cycle = 10;         // the link would close a cycle
  static constexpr std::uint8_t too_deep = 11;      // Options::max_depth
  static constexpr std::uint8_t frame_limit = 12;   // Options::max_frames
  static constexpr std::uint8_t memory_limit = 13;  // Options::max_memory_bytes
  static constexpr std::uint8_t stray = 14;  // far ahead of the frame's stamps (time_jumps.cpp)
  static constexpr std::uint8_t slashed_name = 15;       // begins with more than one '/'
  static constexpr std::uint8_t translation_limit = 16;  // longer than kMaxTranslation
  static constexpr std::uint8_t bad_name = 17;           // has a zero character

  [[nodiscard]] static bool is_refusal(std::uint8_t result) noexcept {
    return result > from_future;
  }
};

}  // namespace ztf
