// A server as far as readers of its memory can see: a shared tree, its lease, and its socket.
//
// Thread safety: the world's.
#pragma once

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <thread>

#include "fixture.hpp"
#include "shared/lease.hpp"

namespace ztf {

// A folder that nobody else has, for sockets.
class SocketFolder {
 public:
  SocketFolder() {
    char text[] = "/tmp/ztf-c-api-XXXXXX";
    path = ::mkdtemp(text);
  }
  ~SocketFolder() { std::filesystem::remove_all(path); }
  std::string path;
};

// The socket, from which readers get the descriptor of a region.
class HandOver {
 public:
  HandOver(const SocketFolder& folder, const std::string& instance, const std::string& tree,
           int region)
      : tree_(tree), region_(region), path_(folder.path + "/" + tree + "-" + instance + ".sock") {
    listener_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path_.c_str(), path_.size());
    CHECK_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    CHECK_EQ(::listen(listener_, 16), 0);
    thread_ = std::thread([this] { hand_over(); });
  }
  ~HandOver() {
    ::shutdown(listener_, SHUT_RDWR);
    thread_.join();
    ::close(listener_);
    std::filesystem::remove(path_);
  }
  HandOver(const HandOver&) = delete;
  HandOver& operator=(const HandOver&) = delete;

 private:
  void hand_over() {
    for (int peer; (peer = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC)) >= 0;
         ::close(peer)) {
      // A map with a number, a list of two numbers, and the name of the tree at its end.
      std::string message("\x83\xa1v\x01\xa6layout\x92\x07\xcf", 14);
      message += std::string(8, '\x11') + "\xa4tree";
      message += static_cast<char>(0xa0 + tree_.size()) + tree_;
      const auto size = static_cast<std::uint32_t>(message.size());
      message.insert(0, reinterpret_cast<const char*>(&size), sizeof size);
      iovec part{message.data(), message.size()};
      alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
      msghdr header{};
      header.msg_iov = &part;
      header.msg_iovlen = 1;
      header.msg_control = control;
      header.msg_controllen = sizeof control;
      cmsghdr* const rights = CMSG_FIRSTHDR(&header);
      rights->cmsg_level = SOL_SOCKET;
      rights->cmsg_type = SCM_RIGHTS;
      rights->cmsg_len = CMSG_LEN(sizeof(int));
      std::memcpy(CMSG_DATA(rights), &region_, sizeof region_);
      (void)!::sendmsg(peer, &header, MSG_NOSIGNAL);
    }
  }

  const std::string tree_;
  const int region_;
  const std::string path_;
  int listener_;
  std::thread thread_;
};

class Owner {
 public:
  Owner(const SocketFolder& folder, const std::string& instance, const std::string& tree = "main")
      : world({.cache_ns = 1'000'000'000,
               .max_memory_bytes = 1 << 26,  // an emulator reserves them
               .shared = true,
               .instance = instance}),
        keeper_(world.tree.state()),
        socket_(folder, instance, tree, world.tree.descriptor()) {}

  World world;

 private:
  LeaseKeeper keeper_;
  HandOver socket_;
};

}  // namespace ztf
