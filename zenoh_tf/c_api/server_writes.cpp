#include "c_api/server_writes.hpp"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <random>
#include <thread>
#include <unordered_map>
#include <vector>

#include "base/rejected.hpp"
#include "c_api/calls.hpp"
#include "c_api/message_map.hpp"
#include "messages/writer.hpp"
#include "system/host.hpp"

namespace ztf {

namespace {

constexpr std::int64_t kAskAgainNs = 20'000'000;
constexpr std::size_t kRowBytes = 80;  // of a row, about
constexpr std::string_view kTrue = "\xc3", kFalse = "\xc2", kVersion("\x01");

// A name as a chunk of a key.
std::string escaped(std::string_view name) {
  if (name.empty()) return "%";
  const auto is_unsafe = [](std::string_view c) {
    if (c.size() == 1)
      return static_cast<unsigned char>(c[0]) <= 0x20 || c[0] == 0x7f ||
             std::string_view("/*$?#%@").find(c[0]) != std::string_view::npos;
    return (c[0] == '\xc2' && static_cast<unsigned char>(c[1]) < 0xa0) || c == "\u2028" ||
           c == "\u2029";
  };
  std::string out;
  while (!name.empty()) {
    std::size_t size = 1;
    while (size < name.size() && (static_cast<unsigned char>(name[size]) & 0xc0) == 0x80) ++size;
    const std::string_view character = name.substr(0, size);
    name.remove_prefix(size);
    if (!is_unsafe(character)) {
      out += character;
      continue;
    }
    constexpr char kDigits[] = "0123456789ABCDEF";
    for (const unsigned char byte : character)
      out.append({'%', kDigits[byte >> 4], kDigits[byte & 15]});
  }
  return out;
}

std::string bytes_of(std::uint64_t value) {  // big-endian
  std::string bytes;
  for (int bits = 56; bits >= 0; bits -= 8) bytes.push_back(static_cast<char>(value >> bits));
  return bytes;
}

// The fields with which a write runs at most once. There are kOnceFields.
constexpr std::size_t kOnceFields = 3;
std::string once_fields(std::int64_t expires_ns, const std::string& instance) {
  std::random_device random;
  std::string id;
  while (id.size() < 16) id += bytes_of(std::uint64_t{random()} << 32 | random());
  return MessageWriter()
      .text("id")
      .binary(id)
      .text("expires_ns")
      .raw("\xd3")
      .raw(bytes_of(static_cast<std::uint64_t>(expires_ns)))
      .text("instance")
      .text(instance)
      .take();
}

template <class T>
std::string_view column(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), sizeof(T) * values.size()};
}

std::string commit_body(const CommitRequest& request, std::string_view once) {
  // Each name once.
  std::vector<std::string_view> names;
  std::unordered_map<std::string_view, std::uint32_t> indexes;
  const auto index_of = [&](std::uint32_t name) {
    const std::string_view text = request.names[name];
    const auto [at, is_new] = indexes.try_emplace(text, static_cast<std::uint32_t>(names.size()));
    if (is_new) names.push_back(text);
    return at->second;
  };
  std::vector<std::uint32_t> parents, children;
  std::vector<Stamp> stamps;
  std::vector<Pose> poses;
  for (const Row& row : request.rows) {
    parents.push_back(index_of(row.parent)), children.push_back(index_of(row.child));
    stamps.push_back(row.stamp), poses.push_back(row.pose);
  }
  const bool has_reads = !request.read_names.empty();
  MessageWriter out(kRowBytes * (1 + request.rows.size()) + 256);
  out.map(9 + (has_reads ? 2 : 0) + kOnceFields).raw(once);
  out.text("v").raw(kVersion).text("names").list(names.size());
  for (const std::string_view name : names) out.text(name);
  out.text("parent").binary(column(parents)).text("child").binary(column(children));
  out.text("stamp").binary(column(stamps)).text("pose").binary(column(poses));
  out.text("authority").text(request.authority);
  out.text("static").raw(request.is_static ? kTrue : kFalse);
  out.text("drop_old").raw(request.drop_old ? kTrue : kFalse);
  if (has_reads) {
    out.text("read_names").list(request.read_names.size());
    for (const std::string_view name : request.read_names) out.text(name);
    out.text("read_versions")
        .binary({reinterpret_cast<const char*>(request.read_versions.data()),
                 request.read_versions.size_bytes()});
  }
  return out.take();
}

// The error in a reply.
Rejected rejected_of(const MessageMap& error) {
  const MessageMap facts = error.map("facts");
  const auto text = [&](const char* name) { return std::string(facts.text(name).value_or("")); };
  const auto number = [&](const char* name, std::int64_t none) {
    const std::optional<double> real = facts.real(name);
    return facts.integer(name).value_or(
        real && std::abs(*real) < 0x1p62 ? static_cast<std::int64_t>(*real) : none);
  };
  const std::int64_t code = error.integer("code").value_or(0);
  return {.code = code > 1 && code < 64 ? static_cast<Code>(code) : Code{ZTF_FAILED},
          .message = std::string(error.text("message").value_or("the server refused the write")),
          .frame = text("frame"),
          .parent = text("parent_frame"),
          .field = text("field"),
          .stamp = number("stamp_ns", kNoStamp),
          .oldest = number("oldest_stamp_ns", kNoStamp),
          .newest = number("newest_stamp_ns", kNoStamp),
          .limit = number("limit", -1),
          .value = number("value", -1),
          .retry_after_s = facts.real("retry_after_s").value_or(-1)};
}

void pause(std::int64_t duration_ns, std::int64_t deadline_ns) {
  const std::int64_t left = deadline_ns - monotonic_ns();
  std::this_thread::sleep_for(std::chrono::nanoseconds(
      std::clamp<std::int64_t>(duration_ns, 0, std::max<std::int64_t>(left, 0))));
}

}  // namespace

ServerWrites::ServerWrites(std::string_view tree, ztf_query_fn query, void* context,
                           std::int64_t timeout_ns)
    : prefix_(std::string("tf/v1/").append(escaped(tree))),
      query_(query),
      context_(context),
      timeout_ns_(timeout_ns) {}

std::string ServerWrites::ask(const std::string& key, std::string_view message,
                              std::int64_t deadline_ns) {
  ztf_reply reply;
  const std::int64_t left_ns = deadline_ns - monotonic_ns();
  if (left_ns > 0) query_(context_, key.c_str(), message.data(), message.size(), left_ns, &reply);
  if (reply.is_lost) throw std::bad_alloc();
  return std::move(reply.bytes);
}

bool ServerWrites::has_rules(const std::string& instance, std::int64_t deadline_ns) {
  {
    const std::lock_guard lock(mutex_);
    if (known_instance_ == instance) return has_rules_;
  }
  const std::string hello =
      MessageWriter().map(2).text("v").raw(kVersion).text("what").text("hello").take();
  while (monotonic_ns() < deadline_ns) {
    const std::string reply = ask(prefix_ + "/hello", hello, deadline_ns);
    const MessageMap value = MessageMap(reply).map("value");
    if (value.text("instance") == instance) {
      const std::lock_guard lock(mutex_);
      known_instance_ = instance;
      return has_rules_ = value.has("access");
    }
    if (value.has("instance"))
      c_api::reject(kServerRestarted, "another server than that of the memory has the tree now");
    pause(kAskAgainNs, deadline_ns);
  }
  c_api::reject(kServerUnavailable,
                "nobody answers on " + prefix_ + ": does the Zenoh session reach the server?");
}

std::string ServerWrites::run(std::string_view type, std::string_view subject,
                              const std::string& instance,
                              const std::function<std::string(std::string_view)>& body) {
  const std::int64_t deadline_ns = monotonic_ns() + timeout_ns_;
  std::string key = std::string(prefix_).append("/").append(type);
  if (has_rules(instance, deadline_ns)) key.append("/").append(escaped(subject));
  const std::string message = body(once_fields(deadline_ns, instance));
  bool may_have_run = false;
  while (monotonic_ns() < deadline_ns) {
    std::string reply = ask(key, message, deadline_ns);
    const MessageMap map(reply);
    if (!map.is_map()) {  // none came, or Zenoh's own error: the server may have run it
      may_have_run = true;
      pause(kAskAgainNs, deadline_ns);
      continue;
    }
    if (!map.has("error")) return reply;
    Rejected rejected = rejected_of(map.map("error"));
    if (rejected.code == kServerBusy) {  // it did not run
      pause(static_cast<std::int64_t>(std::clamp(rejected.retry_after_s, 0.001, 1.0) * 1e9),
            deadline_ns);
      continue;
    }
    // These say that this request did not run, but an earlier one with the same id may have.
    const bool says_little = rejected.code == Code::timeout || rejected.code == kServerRestarted;
    if (may_have_run && says_little) break;
    throw rejected;
  }
  if (!may_have_run)
    c_api::reject(Code::timeout, "the server was too busy until the write's time was over");
  c_api::reject(kOutcomeUnknown, "no reply in time: the write was done, or never will be");
}

void ServerWrites::commit(const CommitRequest& request, std::span<std::uint8_t> results,
                          const std::string& instance) {
  const std::string reply = run("commit", request.authority, instance,
                                [&](std::string_view once) { return commit_body(request, once); });
  const std::optional<std::string_view> stored = MessageMap(reply).binary("stored");
  if (!stored || stored->size() != request.rows.size())
    c_api::reject(kProtocol, "the reply does not say what was stored");
  std::ranges::copy(*stored, results.begin());
}

void ServerWrites::clear(bool keep_static, const std::string& instance) {
  (void)run("admin", "clear", instance, [&](std::string_view once) {
    MessageWriter out;
    out.map(3 + kOnceFields).raw(once).text("v").raw(kVersion).text("what").text("clear");
    return out.text("keep_static").raw(keep_static ? kTrue : kFalse).take();
  });
}

void ServerWrites::remove_frame(std::string_view frame, bool subtree, const std::string& instance) {
  (void)run("admin", "remove_frame", instance, [&](std::string_view once) {
    MessageWriter out;
    out.map(4 + kOnceFields).raw(once).text("v").raw(kVersion).text("what").text("remove_frame");
    return out.text("name").text(frame).text("subtree").raw(subtree ? kTrue : kFalse).take();
  });
}

}  // namespace ztf
