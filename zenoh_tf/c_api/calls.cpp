#include "c_api/calls.hpp"

#include "by_name/errors.hpp"

namespace ztf::c_api {

void reject(Code code, std::string message, const char* field) {
  throw Rejected{.code = code, .message = std::move(message), .field = field};
}

std::string_view text_of(const char* text, const char* field) {
  if (!text) reject(Code::invalid_argument, std::string(field) + " is NULL", field);
  return text;
}

std::string_view name_of(const char* name, const char* field) {
  const std::string_view text = text_of(name, field);
  if (!is_frame_name(text)) throw *name_fault(text, field);
  return text;
}

Op op_of(ztf_op op, std::int64_t stamp) {
  if (op < ZTF_AT || op > ZTF_LATEST_XACT) reject(Code::invalid_argument, "unknown op", "op");
  if (op == ZTF_AT && stamp == kNoStamp)
    reject(Code::invalid_argument, "stamp_ns is ZTF_NO_STAMP", "stamp_ns");
  return static_cast<Op>(op);
}

ztf_code report(const Rejected& r, ztf_error* error) noexcept {
  if (!error) return code_of(r.code);
  ztf_error out{};
  out.code = code_of(r.code);
  out.stamp_ns = r.stamp, out.oldest_stamp_ns = r.oldest, out.newest_stamp_ns = r.newest;
  out.gap_ns = r.gap, out.value = r.value;
  out.limit = r.max_gap >= 0 ? r.max_gap : r.limit;
  out.retry_after_s = r.retry_after_s;
  copy_text(r.message, out.message), copy_text(r.field, out.field);
  copy_text(r.target, out.target_frame), copy_text(r.source, out.source_frame);
  copy_text(r.frame, out.frame), copy_text(r.parent, out.parent_frame);
  copy_text(r.target_root, out.target_root), copy_text(r.source_root, out.source_root);
  write_sized(out, error);
  return code_of(r.code);
}

ztf_code report(const ztf_tree* tree, Unanswered::Reason reason, ztf_error* error) {
  const bool is_lapsed = reason == Unanswered::Reason::lapsed;
  const bool is_busy = reason == Unanswered::Reason::busy;
  if (!error)
    return code_of(is_lapsed ? tree->server->code_if_lapsed() : is_busy ? kServerBusy : kProtocol);
  if (is_lapsed) return report(tree->server->why_lapsed(), error);
  if (is_busy)
    return report(
        {.code = kServerBusy, .message = "writers changed the links while they were read"}, error);
  return report({.code = kProtocol, .message = "the server's memory could not be read"}, error);
}

}  // namespace ztf::c_api
