// The tree of a server on this host, whichever server has it.
//
// A thread follows the server: where the lease of the mapped tree has lapsed, it maps the tree of
// the server that has it now. Readers take no lock for that: each announces itself in a counter,
// and a tree that was replaced is unmapped once every counter was seen at 0. A reader that comes
// later finds the new tree, as counting, loading and replacing are sequentially consistent.
//
// Thread safety: every function, from any thread; construction and destruction by one.
#pragma once

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "base/rejected.hpp"
#include "c_api/handover.hpp"
#include "records/counters.hpp"

namespace ztf {

class ServerTree {
 public:
  // Waits for a server up to `timeout_ns`. Throws Rejected and bad_alloc.
  ServerTree(std::string_view tree, std::string_view folder, std::int64_t timeout_ns);
  ~ServerTree();
  ServerTree(const ServerTree&) = delete;
  ServerTree& operator=(const ServerTree&) = delete;

  // Runs body(tree, number): `number` differs for each mapping of a tree in this process.
  template <class Body>
  auto read(Body&& body) const {
    const Reading reading(readers_[shard_of_thread<kShards>()].count);
    const Mapped& mapped = *mapped_.load(std::memory_order_seq_cst);
    return body(*mapped.tree, mapped.number);
  }

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  // Why there is no answer while the lease has lapsed.
  [[nodiscard]] Rejected why_lapsed() const;
  // Its code, without a lock.
  [[nodiscard]] Code code_if_lapsed() const noexcept { return code_if_lapsed_.load(); }
  [[nodiscard]] std::uint32_t times_mapped() const noexcept {
    return times_mapped_.load(std::memory_order_relaxed);
  }

 private:
  struct Mapped {
    std::unique_ptr<const SharedTree> tree;
    std::uint64_t number;
  };
  class Reading {
   public:
    explicit Reading(std::atomic<std::uint32_t>& count) noexcept : count_(count) {
      count_.fetch_add(1, std::memory_order_seq_cst);
    }
    ~Reading() { count_.fetch_sub(1, std::memory_order_release); }
    Reading(const Reading&) = delete;
    Reading& operator=(const Reading&) = delete;

   private:
    std::atomic<std::uint32_t>& count_;
  };
  struct alignas(64) Readers {
    std::atomic<std::uint32_t> count{0};
  };
  static constexpr std::size_t kShards = 16;

  [[nodiscard]] bool is_live() const noexcept;
  void follow();
  // Maps the tree of the server that has it. Throws Rejected and bad_alloc.
  void map();
  // Pauses, unless the tree is to be closed: then it returns false.
  bool pause(std::chrono::nanoseconds duration);

  const std::string name_, folder_;
  mutable Readers readers_[kShards];
  std::unique_ptr<const Mapped> owned_;  // the thread's, once it runs
  std::atomic<const Mapped*> mapped_{nullptr};
  std::atomic<std::uint32_t> times_mapped_{0};
  std::atomic<Code> code_if_lapsed_{kServerUnavailable};
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool closing_ = false;             // guarded by mutex_
  std::optional<Rejected> failure_;  // guarded by mutex_: of the last attempt to map the tree
  std::thread thread_;
};

// A number for a tree of this process, or a mapping, that no other one has.
std::uint64_t next_tree_number() noexcept;

}  // namespace ztf
