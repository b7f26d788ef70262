// One of the systems that are compared.
//
// Thread safety: lookup_or_park() and run() from any thread, a thread number from one at a time.
#pragma once

#include <memory>

#include "workload.hpp"

namespace bench {

struct Reply {
  ztf::Pose pose;
  Stamp stamp;
};

class Side {
 public:
  virtual ~Side() = default;

  [[nodiscard]] virtual std::string name() const = 0;

  // For the check of the answers; no time: latest common.
  virtual Reply ask(const std::string& target, const std::string& source,
                    std::optional<Stamp> time) = 0;

  // Does a case's call that many times. Virtual once for all of them: the loop is the side's own.
  virtual void run(const Case& what, std::size_t calls, unsigned thread) = 0;
};

// With the history in it. `concurrency`: "optimistic", "2pl" or "giant".
std::unique_ptr<Side> make_tree_side(const std::string& concurrency);
// Null where this program was built without tf2.
std::unique_ptr<Side> make_tf2_side();

// Keeps a result from being optimised away.
inline void keep(const double& value) { asm volatile("" : : "m"(value) : "memory"); }

}  // namespace bench
