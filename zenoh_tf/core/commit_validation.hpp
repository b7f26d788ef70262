// What can be said about a commit without looking into the tree.
//
// Thread safety: functions of their arguments.
#pragma once

#include <cmath>
#include <string>

#include "tree.hpp"

namespace ztf {

inline std::string quoted(std::string_view name) {
  return std::string("'").append(name).append("'");
}

// tf2's rule: one leading slash is stripped on insert.
inline std::string_view stripped(std::string_view name) noexcept {
  return name.starts_with('/') ? name.substr(1) : name;
}

[[noreturn]] inline void reject(const CommitRequest& request, const Row& row, const char* field,
                                const std::string& why) {
  const std::string parent(stripped(request.names[row.parent]));
  const std::string child(stripped(request.names[row.child]));
  throw Rejected{.code = Code::invalid_argument,
                 .message = "transform of child " + quoted(child) + " in parent " + quoted(parent) +
                            " refused: " + why,
                 .frame = child,
                 .parent = parent,
                 .field = field,
                 .stamp = row.stamp};
}

[[noreturn]] inline void reject_frame(std::string_view name, std::uint32_t max_frames) {
  throw Rejected{.code = Code::limit,
                 .message = "frame " + quoted(name) + " would be one more than " +
                            std::to_string(max_frames) + " frames",
                 .frame = std::string(name),
                 .field = "max_frames",
                 .limit = max_frames};
}

[[noreturn]] inline void reject_authority(std::uint32_t max_authorities) {
  throw Rejected{.code = Code::limit,
                 .message = "no more than " + std::to_string(max_authorities) + " authorities",
                 .field = "max_authorities",
                 .limit = max_authorities};
}

[[noreturn]] inline void reject_conflict(std::string_view name) {
  throw Rejected{.code = Code::conflict,
                 .message = "frame " + quoted(name) + " has changed since the transaction read it",
                 .frame = std::string(name)};
}

inline void check_length(std::size_t bytes, const char* what, const Options& options) {
  if (bytes <= options.max_name_bytes) return;
  throw Rejected{.code = Code::limit,
                 .message = std::string(what) + ": a name of " + std::to_string(bytes) +
                            " bytes exceeds the limit of " + std::to_string(options.max_name_bytes),
                 .field = "max_name_bytes",
                 .limit = options.max_name_bytes,
                 .value = static_cast<std::int64_t>(bytes)};
}

inline void check_authority(const CommitRequest& request, const Options& options) {
  check_length(request.authority.size(), "authority", options);
}

[[noreturn]] inline void reject_pose(const CommitRequest& request, const Row& row, double norm2) {
  const double* const values = &row.pose.x;
  for (int i = 0; i < 7; ++i)
    if (!std::isfinite(values[i]))
      reject(request, row, i < 3 ? "translation" : "rotation", "a value is not finite");
  reject(request, row, "rotation",
         "the quaternion's squared norm is " + std::to_string(norm2) + ", not 1");
}

inline bool is_valid_name(std::string_view name, const Options& options) noexcept {
  return !name.empty() && name.size() <= options.max_name_bytes;
}

inline void check_names(const CommitRequest& request, const Row& row, const Options& options) {
  const auto check_name = [&](std::uint32_t index, const char* field) {
    const std::string_view name = stripped(request.names[index]);
    if (name.empty()) reject(request, row, field, "the name is empty");
    check_length(name.size(), field, options);
    return name;
  };
  const std::string_view parent = check_name(row.parent, "parent_frame");
  if (check_name(row.child, "child_frame") == parent)
    reject(request, row, "child_frame", "a frame cannot be its own parent");
}

// Gives the row's pose with its rotation normalised, in place: who copies what was stored in parts
// just before, waits.
inline void check_values(const CommitRequest& request, const Row& row, Pose& pose) {
  if (row.stamp == kNoStamp) reject(request, row, "stamp_ns", "the stamp is out of range");
  const Pose& p = row.pose;
  const double norm2 = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw;
  const double excess = norm2 - 1.0;
  // A sum of zeros, unless a value is not finite.
  const double zero = (p.x - p.x) + (p.y - p.y) + (p.z - p.z);
  if (zero != 0 || !(std::abs(excess) < 1e-2)) [[unlikely]]
    reject_pose(request, row, norm2);
  // Mostly the next term of the root's series, 3/8 excess^2, is nothing.
  const double scale = std::abs(excess) < 1e-8 ? 1.0 - 0.5 * excess : 1.0 / std::sqrt(norm2);
  pose.x = p.x, pose.y = p.y, pose.z = p.z;
  pose.qx = p.qx * scale, pose.qy = p.qy * scale;
  pose.qz = p.qz * scale, pose.qw = p.qw * scale;
}

}  // namespace ztf
