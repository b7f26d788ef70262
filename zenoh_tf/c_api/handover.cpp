#include "c_api/handover.hpp"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "c_api/calls.hpp"
#include "c_api/message_map.hpp"
#include "system/host.hpp"

namespace ztf {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostBytes = 1 << 16;  // of a greeting
constexpr std::int64_t kTimeoutNs = 500'000'000, kRetryNs = 5'000'000;

class Descriptor {
 public:
  explicit Descriptor(int number = -1) noexcept : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  [[nodiscard]] int get() const noexcept { return number_; }

 private:
  int number_;
};

struct Greeting {
  std::string message;
  Descriptor region;
};

// The error of the last call of the system.
[[noreturn]] void fail_system(const std::string& what) {
  const int error = errno;
  c_api::reject(error == EACCES || error == EPERM ? kAccessDenied : kServerUnavailable,
                what + ": " + std::strerror(error));
}

// Requires that nobody but root and the owners can replace a socket in the folder, or in one above
// it. Where the sticky bit is set, as in /tmp, others may add names, but replace none.
void check_folder(const fs::path& folder, uid_t owner, uid_t other_owner) {
  for (fs::path each = fs::canonical(folder);; each = each.parent_path()) {
    struct stat status{};
    if (::stat(each.c_str(), &status) != 0) fail_system(each);
    if (status.st_uid != 0 && status.st_uid != owner && status.st_uid != other_owner)
      c_api::reject(kAccessDenied, each.string() + " belongs to another user");
    if ((status.st_mode & (S_IWGRP | S_IWOTH)) && !(status.st_mode & S_ISVTX))
      c_api::reject(kAccessDenied, "others may write to " + each.string() + ": chmod go-w it");
    if (each == each.root_path()) return;
  }
}

// Requires that the process at the other end is of root, of this user, or of the folder's owner.
void check_peer(int peer, const fs::path& path) {
  struct stat status{};
  if (::stat(path.parent_path().c_str(), &status) != 0) fail_system(path.parent_path());
  const uid_t own = ::geteuid(), owner = status.st_uid;
  check_folder(path.parent_path(), own, owner);
  ucred user{};
  socklen_t size = sizeof user;
  if (::getsockopt(peer, SOL_SOCKET, SO_PEERCRED, &user, &size) != 0) fail_system(path);
  if (user.uid != 0 && user.uid != own && user.uid != owner)
    c_api::reject(kAccessDenied, path.string() + " is the socket of another user");
}

// Connects, also while many others do: then the kernel refuses at first.
Descriptor connect_to(const fs::path& path, std::int64_t deadline_ns) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.native().size() >= sizeof address.sun_path)
    c_api::reject(Code::invalid_argument, "the path of the socket is too long: " + path.string());
  std::memcpy(address.sun_path, path.c_str(), path.native().size());
  Descriptor peer(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (peer.get() < 0) fail_system("socket");
  while (::connect(peer.get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    if (errno != EAGAIN || monotonic_ns() > deadline_ns) fail_system(path);
    const timespec pause{0, kRetryNs};
    ::nanosleep(&pause, nullptr);
  }
  const timeval timeout{0, kTimeoutNs / 1000};
  if (::fcntl(peer.get(), F_SETFL, 0) != 0 ||
      ::setsockopt(peer.get(), SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout) != 0)
    fail_system(path);
  check_peer(peer.get(), path);
  return peer;
}

// Receives exactly that many bytes, and the descriptor, if one comes with them.
void receive(int peer, char* out, std::size_t size, Descriptor& region, const fs::path& path) {
  while (size > 0) {
    iovec part{out, size};
    alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))];
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    const ssize_t received = ::recvmsg(peer, &message, MSG_CMSG_CLOEXEC);
    if (received < 0 && errno == EINTR) continue;
    if (received < 0) fail_system(path);
    if (received == 0)
      c_api::reject(kServerUnavailable, path.string() + ": the connection ended early");
    if (const cmsghdr* const part_of = CMSG_FIRSTHDR(&message);
        part_of && part_of->cmsg_level == SOL_SOCKET && part_of->cmsg_type == SCM_RIGHTS) {
      int number = -1;
      std::memcpy(&number, CMSG_DATA(part_of), sizeof number);
      region = Descriptor(number);
    }
    out += received;
    size -= static_cast<std::size_t>(received);
  }
}

Greeting greet(const fs::path& path) {
  const Descriptor peer = connect_to(path, monotonic_ns() + kTimeoutNs);
  Greeting greeting;
  std::uint32_t size = 0;  // little-endian, as this host
  receive(peer.get(), reinterpret_cast<char*>(&size), sizeof size, greeting.region, path);
  if (size > kMostBytes) c_api::reject(kProtocol, path.string() + " is no server of zenoh-tf");
  greeting.message.resize(size);
  receive(peer.get(), greeting.message.data(), size, greeting.region, path);
  if (greeting.region.get() < 0)
    c_api::reject(kProtocol, path.string() + " sent no file descriptor");
  return greeting;
}

std::vector<fs::path> folders_of(const std::string& folder) {
  if (!folder.empty()) return {folder};
  std::vector<fs::path> folders;
  if (const char* const own = std::getenv("XDG_RUNTIME_DIR"); own && own[0] == '/')
    folders.push_back(fs::path(own) / "zenoh-tf");
  folders.emplace_back("/run/zenoh-tf");
  return folders;
}

// What the names of the tree's sockets begin with (Sharing in zenoh_tf_server).
std::string socket_prefix(std::string_view tree) {
  std::string prefix;
  for (const char c : tree) {  // a character of several bytes becomes one '_'
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                          (c >= '0' && c <= '9') || c == '_' || c == '-';
    if ((static_cast<unsigned char>(c) & 0xc0) == 0x80) continue;
    prefix.push_back(is_plain ? c : '_');
  }
  return prefix.substr(0, 40) + "-";
}

std::vector<fs::path> sockets_of(std::string_view tree, const fs::path& folder) {
  const std::string prefix = socket_prefix(tree);
  std::vector<fs::path> sockets;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& path = entry->path();
    if (path.filename().native().starts_with(prefix) && path.extension() == ".sock")
      sockets.push_back(path);
  }
  if (error == std::errc::permission_denied)
    c_api::reject(kAccessDenied, folder.string() + ": " + error.message());
  return sockets;
}

// Maps the tree behind a socket; null if it is another one, or its server has stopped. Throws
// Rejected and bad_alloc.
std::unique_ptr<SharedTree> map_from(const fs::path& path, std::string_view tree) {
  const Greeting greeting = greet(path);
  if (MessageMap(greeting.message).text("tree") != tree) return nullptr;
  try {
    auto mapped = std::make_unique<SharedTree>(greeting.region.get());
    if (monotonic_ns() >= mapped->lease_ns()) return nullptr;
    return mapped;
  } catch (const RegionRefused& refused) {
    c_api::reject(kProtocol, path.string() + ": " + refused.what());
  }
}

// Maps the tree of the one server in a folder that has it; null if none has. Sets `failure` to what
// has failed meanwhile. Throws Rejected if several have it or the folder may not be read, and
// bad_alloc.
std::unique_ptr<SharedTree> map_in(const fs::path& folder, std::string_view tree,
                                   std::optional<Rejected>& failure) {
  std::unique_ptr<SharedTree> found;
  const auto note = [&](Rejected rejected) {
    // Mostly that of a server which was killed. Any other reason says more.
    if (!failure || failure->code == kServerUnavailable) failure = std::move(rejected);
  };
  try {
    for (const fs::path& path : sockets_of(tree, folder)) {
      std::unique_ptr<SharedTree> mapped;
      try {
        mapped = map_from(path, tree);
      } catch (Rejected& rejected) {
        note(std::move(rejected));
      }
      if (!mapped) continue;
      // A replica and its primary have the same instance.
      if (found && found->options().instance != mapped->options().instance)
        c_api::reject(Code::invalid_argument,
                      "several servers have a tree " + quoted(tree) + " in " + folder.string() +
                          ": give each a --share-dir, and name the folder of the one to read");
      found = std::move(mapped);
    }
  } catch (const fs::filesystem_error& error) {
    note({.code = kServerUnavailable, .message = error.what()});
  }
  return found;
}

}  // namespace

std::unique_ptr<SharedTree> map_server_tree(std::string_view tree, const std::string& folder) {
  std::optional<Rejected> failure;
  for (const fs::path& each : folders_of(folder))
    if (std::unique_ptr<SharedTree> found = map_in(each, tree, failure)) return found;
  if (failure && failure->code != kServerUnavailable) throw *std::move(failure);
  c_api::reject(kServerUnavailable, "no server on this host shares a tree " + quoted(tree) +
                                        (failure ? " (" + failure->message + ")" : ""));
}

}  // namespace ztf
