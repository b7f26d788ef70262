// What every function of zenoh_tf.h begins and ends with: its tree, its arguments, its errors.
//
// Thread safety: every function, from any thread.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <string>
#include <string_view>

#include "base/rejected.hpp"
#include "c_api/server_tree.hpp"
#include "c_api/server_writes.hpp"
#include "reads/query.hpp"
#include "shared/shared_tree.hpp"
#include "tree.hpp"
#include "zenoh_tf/zenoh_tf.h"

// One of this process, or one of a server with, perhaps, its writes.
struct ztf_tree {
  const std::uint64_t number = ztf::next_tree_number();
  std::unique_ptr<ztf::Tree> own = {};
  std::unique_ptr<ztf::ServerTree> server = {};
  std::unique_ptr<ztf::ServerWrites> writes = {};
};

namespace ztf::c_api {

constexpr auto kFailed = Code{ZTF_FAILED}, kTooSmall = Code{ZTF_BUFFER_TOO_SMALL};

// --- values

inline ztf_code code_of(Code code) noexcept { return static_cast<ztf_code>(code); }
inline ztf_pose pose_of(const Pose& p) noexcept { return {p.x, p.y, p.z, p.qx, p.qy, p.qz, p.qw}; }
inline Pose pose_of(const ztf_pose& p) noexcept { return {p.x, p.y, p.z, p.qx, p.qy, p.qz, p.qw}; }

template <std::size_t size>
void copy_text(const std::string& text, char (&out)[size]) noexcept {
  const std::size_t n = std::min(text.size(), size - 1);
  std::memcpy(out, text.data(), n);
  std::memset(out + n, 0, size - n);
}

// Writes as much of a structure as its caller knows.
template <class Struct>
void write_sized(Struct value, Struct* out) noexcept {
  value.size = out->size;
  std::memcpy(out, &value, std::min<std::size_t>(out->size, sizeof value));
}
// Reads as much of a structure as its caller knows; the rest is as in `value`.
template <class Struct>
Struct read_sized(const Struct* in, Struct value) noexcept {
  if (in) std::memcpy(&value, in, std::min<std::size_t>(in->size, sizeof value));
  return value;
}

// A frame as this tree's, or no frame if it is another's.
inline NameRef ref_of(const ztf_frame& frame, std::uint64_t tree_number) noexcept {
  return frame.tree == tree_number ? NameRef{frame.id, frame.generation} : NameRef();
}

inline void set_answer(const Answer& a, ztf_answer* out) noexcept {
  if (out) write_sized({0, pose_of(a.pose), a.stamp, a.newest, a.gap}, out);
}

[[noreturn]] void reject(Code code, std::string message, const char* field = "");
// These throw Rejected. A text that is not NULL.
std::string_view text_of(const char* text, const char* field);
// A name that a frame may have.
std::string_view name_of(const char* name, const char* field);
// An op that has a stamp, if it needs one.
Op op_of(ztf_op op, std::int64_t stamp);

// --- errors

ztf_code report(const Rejected& rejected, ztf_error* error) noexcept;
ztf_code report(const ztf_tree* tree, Unanswered::Reason reason, ztf_error* error);

// Runs body(), which returns a code, and reports what it throws.
template <class Body>
ztf_code guarded(const ztf_tree* tree, ztf_error* error, Body&& body) noexcept {
  try {
    try {
      return code_of(body());
    } catch (const Rejected& rejected) {
      return report(rejected, error);
    } catch (const Unanswered& unanswered) {
      return report(tree, unanswered.reason, error);
    } catch (const std::bad_alloc&) {
      return report({.code = Code::limit, .message = "no memory", .field = "host_memory"}, error);
    } catch (const std::exception& other) {
      return report({.code = kFailed, .message = other.what()}, error);
    }
  } catch (...) {
    return ZTF_LIMIT;  // no memory for the text either
  }
}

// Runs body(tree, its number) for the tree that is read.
template <class Body>
auto read(const ztf_tree* tree, Body&& body) {
  if (tree->own) return body(*tree->own, tree->number);
  return tree->server->read(body);
}

}  // namespace ztf::c_api
