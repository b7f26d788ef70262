// Finds the server on this host that has a tree, and maps the tree, as Python's clients do
// (docs/reference/protocol.md, "Shared memory").
//
// Thread safety: every function, from any thread.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "shared/shared_tree.hpp"

namespace ztf {

// The codes of zenoh_tf/errors.py that only servers' trees have.
constexpr auto kServerUnavailable = Code{13}, kProtocol = Code{16}, kServerBusy = Code{17},
               kAccessDenied = Code{18}, kReadOnly = Code{20};

// Maps the tree of that name of the one server that has it now. `folder` has the servers' sockets;
// empty: the default folders. Throws Rejected and bad_alloc. Takes some milliseconds at most, and
// up to half a second for each server that has stopped.
std::unique_ptr<SharedTree> map_server_tree(std::string_view tree, const std::string& folder);

}  // namespace ztf
