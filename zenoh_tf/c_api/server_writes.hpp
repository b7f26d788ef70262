// Writes to the tree of a server: requests of docs/reference/protocol.md, which the caller's
// function sends over Zenoh.
//
// The server's clock is this host's CLOCK_MONOTONIC, as for the lease of its memory. So a write
// that got no reply in time ran before its time-out, or never will.
//
// Thread safety: every function, from any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <span>
#include <string>
#include <string_view>

#include "c_api/handover.hpp"
#include "commits/request.hpp"
#include "zenoh_tf/zenoh_tf.h"

// A reply, as the caller's function has it.
struct ztf_reply {
  std::string bytes = {};
  bool is_lost = false;  // no memory
};

namespace ztf {

// The codes of zenoh_tf/errors.py that only writes have.
constexpr auto kOutcomeUnknown = Code{14}, kServerRestarted = Code{15};

class ServerWrites {
 public:
  ServerWrites(std::string_view tree, ztf_query_fn query, void* context, std::int64_t timeout_ns);

  // `instance` is the only server that may run it. All throw Rejected and bad_alloc.
  void commit(const CommitRequest& request, std::span<std::uint8_t> results,
              const std::string& instance);
  void clear(bool keep_static, const std::string& instance);
  void remove_frame(std::string_view frame, bool subtree, const std::string& instance);

 private:
  // Sends a request until there is a reply to it or its time is over, and returns the reply.
  // body(id and more) writes the message.
  std::string run(std::string_view type, std::string_view subject, const std::string& instance,
                  const std::function<std::string(std::string_view)>& body);
  // The bytes of one reply; none if none came.
  std::string ask(const std::string& key, std::string_view message, std::int64_t deadline_ns);
  // Whether the keys of writes must name what they write.
  bool has_rules(const std::string& instance, std::int64_t deadline_ns);

  const std::string prefix_;  // of the tree's keys
  const ztf_query_fn query_;
  void* const context_;
  const std::int64_t timeout_ns_;
  std::mutex mutex_;
  std::string known_instance_;  // guarded by mutex_: that has been asked for its rules
  bool has_rules_ = false;      // guarded by mutex_
};

}  // namespace ztf
