// Checks of a commit that need nothing but the request and the options, and the errors of commits.
//
// Thread safety: functions of their arguments, and of the clock.
#pragma once

#include <cmath>
#include <string>

#include "base/options.hpp"
#include "base/rejected.hpp"
#include "commits/request.hpp"
#include "system/host.hpp"

namespace ztf {

// Formats a count with separators: 1,048,576.
inline std::string with_separators(std::uint64_t value) {
  std::string digits = std::to_string(value);
  for (std::size_t at = digits.size(); at > 3; at -= 3) digits.insert(at - 3, 1, ',');
  return digits;
}

// The longest translation of a link, in metres. It keeps every result finite: a chain of links, and
// the differences and squares of what they give.
constexpr double kMaxTranslation = 1e150;

// Returns a frame's name as it is stored: without one leading slash, as tf2 does on insert. What
// still begins with a slash is no name of a frame: whatever copies the tree would strip it again.
inline std::string_view stripped(std::string_view name) noexcept {
  return name.starts_with('/') ? name.substr(1) : name;
}

// Returns whether a name has a zero character, which ends a text in other languages. Decoders give
// one to names that are no text (messages/cdr.hpp).
inline bool has_zero(std::string_view name) noexcept {
  return name.find('\0') != std::string_view::npos;
}

// Returns a frame's name for an error, which a name that is too long must not fill.
inline std::string shown(std::string_view name) {
  constexpr std::size_t kMost = 255;
  name = stripped(name);
  if (name.size() <= kMost) return std::string(name);
  std::size_t size = kMost;
  while (size > 0 && (static_cast<unsigned char>(name[size]) & 0xc0) == 0x80) --size;
  return std::string(name.substr(0, size)) + "...";
}

// Returns which of several rows an error is about.
inline std::string index_of(const CommitRequest& request, const Row& row) {
  if (request.rows.size() < 2) return "";
  return " (index " + std::to_string(&row - request.rows.data()) + ")";
}

[[noreturn]] inline void reject_stale() {
  throw Rejected{.code = Code::stale_frame,
                 .message = "the frame is of another tree, or was removed: resolve its name again"};
}

// Why a row of a request is not stored.
inline Rejected rejection(const CommitRequest& request, const Row& row, const char* field,
                          const std::string& why) {
  const std::string parent = shown(request.names[row.parent]);
  const std::string child = shown(request.names[row.child]);
  return {.code = Code::invalid_argument,
          .message = "cannot set the transform of child " + quoted(child) + " in parent " +
                     quoted(parent) + index_of(request, row) + ": " + why,
          .frame = child,
          .parent = parent,
          .field = field,
          .stamp = row.stamp};
}

[[noreturn]] inline void reject(const CommitRequest& request, const Row& row, const char* field,
                                const std::string& why) {
  throw rejection(request, row, field, why);
}

inline Rejected frame_rejection(std::string_view name, std::uint32_t max_frames) {
  return {.code = Code::limit,
          .message = "cannot create frame " + quoted(name) + ": the limit of " +
                     with_separators(max_frames) + " frames is reached (max_frames)",
          .frame = std::string(name),
          .field = "max_frames",
          .limit = max_frames};
}

[[noreturn]] inline void reject_authority(std::string_view name, std::uint32_t max_authorities) {
  throw Rejected{.code = Code::limit,
                 .message = "cannot add authority " + quoted(name) + ": the limit of " +
                            with_separators(max_authorities) +
                            " authorities is reached (max_authorities)",
                 .field = "max_authorities",
                 .limit = max_authorities};
}

inline Rejected memory_rejection(const CommitRequest& request, const Row& row,
                                 std::uint64_t max_bytes) {
  const std::string child(stripped(request.names[row.child]));
  return {.code = Code::limit,
          .message = "cannot store samples of frame " + quoted(child) + ": the limit of " +
                     with_separators(max_bytes) + " bytes for all samples is reached (max_memory)",
          .frame = child,
          .parent = std::string(stripped(request.names[row.parent])),
          .field = "max_memory",
          .limit = static_cast<std::int64_t>(max_bytes)};
}

[[noreturn]] inline void reject_conflict(std::string_view name) {
  throw Rejected{.code = Code::conflict,
                 .message = "frame " + quoted(name) +
                            " has changed since the transaction read it: run the transaction again",
                 .frame = std::string(name)};
}

// Requires that the row is later than the request's max_stamp.
inline Rejected future_stamp_rejection(const CommitRequest& request, const Row& row) {
  const std::string child(stripped(request.names[row.child]));
  return {.code = Code::invalid_argument,
          .message = "cannot set the transform of child " + quoted(child) + ": the stamp " +
                     std::to_string(row.stamp) + " ns is later than " +
                     std::to_string(request.max_stamp) + " ns, the latest accepted now",
          .frame = child,
          .parent = std::string(stripped(request.names[row.parent])),
          .field = "stamp",
          .stamp = row.stamp,
          .limit = request.max_stamp,
          .value = row.stamp};
}

// Throws Rejected if a write that expires at this time is too late now.
inline void check_not_expired(std::int64_t expires_ns) {
  if (expires_ns == kNeverExpires) return;
  const std::int64_t now = monotonic_ns();
  if (now < expires_ns) return;
  throw Rejected{.code = Code::timeout,
                 .message = "the write was not applied: it expired " +
                            std::to_string((now - expires_ns) / 1'000'000) +
                            " ms before its turn came (expires_ns)",
                 .field = "expires_ns",
                 .limit = expires_ns,
                 .value = now};
}

inline Rejected long_name_rejection(std::size_t bytes, const char* what, const Options& options) {
  return {.code = Code::limit,
          .message = std::string(what) + ": the name has " + with_separators(bytes) +
                     " bytes, the limit is " + with_separators(options.max_name_bytes) +
                     " (max_name_bytes)",
          .field = "max_name_bytes",
          .limit = options.max_name_bytes,
          .value = static_cast<std::int64_t>(bytes)};
}

inline void check_authority(const CommitRequest& request, const Options& options) {
  const std::size_t bytes = request.authority.size();
  if (bytes > options.max_name_bytes) throw long_name_rejection(bytes, "authority", options);
}

// False also if a value is NaN or infinite.
inline bool is_valid_translation(const Pose& p) noexcept {
  return p.x * p.x + p.y * p.y + p.z * p.z <= kMaxTranslation * kMaxTranslation;
}

// Returns why a row is refused with this result, if the row alone decides it.
inline Rejected row_rejection(const CommitRequest& request, const Row& row, std::uint8_t result,
                              const Options& options) {
  const Pose& p = row.pose;
  const std::string_view parent = stripped(request.names[row.parent]);
  const std::string_view child = stripped(request.names[row.child]);
  switch (result) {
    case RowResult::not_finite: {
      const bool in_translation = !std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z);
      const char* const field = in_translation ? "translation" : "rotation";
      return rejection(request, row, field,
                       std::string("a value of the ") + field + " is NaN or infinite");
    }
    case RowResult::bad_rotation:
      return rejection(request, row, "rotation",
                       "the quaternion's squared norm is " +
                           std::to_string(p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw) +
                           ", but must differ from 1 by less than 0.01: normalise it");
    case RowResult::empty_name:
      return rejection(request, row, parent.empty() ? "parent_frame" : "child_frame",
                       "empty frame id: the name is empty");
    case RowResult::long_name: {
      const bool is_parent = parent.size() > options.max_name_bytes;
      return long_name_rejection((is_parent ? parent : child).size(),
                                 is_parent ? "parent_frame" : "child_frame", options);
    }
    case RowResult::own_parent:
      return rejection(request, row, "child_frame", "a frame cannot be its own parent");
    case RowResult::slashed_name:
      return rejection(request, row, parent[0] == '/' ? "parent_frame" : "child_frame",
                       "the name begins with more than one '/': a frame's name has none in front");
    case RowResult::bad_name:
      return rejection(request, row, has_zero(parent) ? "parent_frame" : "child_frame",
                       "the name is no text: it has a zero character, or came as bytes that are no "
                       "UTF-8");
    case RowResult::translation_limit:
      return rejection(request, row, "translation",
                       "the translation is longer than 1e150 m, the limit: are its units metres?");
    case RowResult::bad_stamp:
      return rejection(request, row, "stamp_ns",
                       "the stamp is no time: it must be greater than -2^63 ns, with nanoseconds "
                       "below 1,000,000,000 beside whole seconds");
    default:
      return future_stamp_rejection(request, row);
  }
}

// True if a stripped name is neither empty nor too long, and does not begin with a slash.
inline bool is_valid_name(std::string_view name, const Options& options) noexcept {
  return !name.empty() && name.size() <= options.max_name_bytes && name[0] != '/';
}

// Returns RowResult::stored if the row has two good names, else why it is refused.
inline std::uint8_t check_names(const CommitRequest& request, const Row& row,
                                const Options& options) noexcept {
  if (request.names.empty()) return RowResult::own_parent;  // else frames have good names
  const std::string_view parent = stripped(request.names[row.parent]);
  const std::string_view child = stripped(request.names[row.child]);
  if (parent.empty() || child.empty()) return RowResult::empty_name;
  if (parent.size() > options.max_name_bytes || child.size() > options.max_name_bytes)
    return RowResult::long_name;
  if (parent[0] == '/' || child[0] == '/') return RowResult::slashed_name;
  if (has_zero(parent) || has_zero(child)) return RowResult::bad_name;
  return parent == child ? RowResult::own_parent : RowResult::stored;
}

// Checks the row's stamp and pose, and stores the pose with its rotation normalised. Returns
// RowResult::stored if they are good, else why the row is refused. It writes through a reference,
// because a copy of a value just stored in parts stalls.
inline std::uint8_t check_values(const Row& row, Pose& pose) noexcept {
  if (row.stamp == kNoStamp) return RowResult::bad_stamp;
  const Pose& p = row.pose;
  const double norm2 = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw;
  if (!is_valid_translation(p) || !(std::abs(norm2 - 1) < 1e-2)) [[unlikely]] {
    const double* const values = &p.x;
    for (int i = 0; i < 7; ++i)
      if (!std::isfinite(values[i])) return RowResult::not_finite;
    return is_valid_translation(p) ? RowResult::bad_rotation : RowResult::translation_limit;
  }
  // This near to 1 the root's series is exact to rounding. It takes 7 % off a commit of one row.
  const double excess = norm2 - 1;
  const double scale = std::abs(excess) < 1e-8 ? 1 - 0.5 * excess : 1 / std::sqrt(norm2);
  pose.x = p.x, pose.y = p.y, pose.z = p.z;
  pose.qx = p.qx * scale, pose.qy = p.qy * scale;
  pose.qz = p.qz * scale, pose.qw = p.qw * scale;
  return RowResult::stored;
}

}  // namespace ztf
