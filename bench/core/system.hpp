// A system under test: a transform tree that holds a forest. C++17, because tf2 needs it.
//
// Thread safety: lookup() and write() from any thread.
#pragma once

#include <memory>

#include "workload.hpp"

namespace bench {

enum class Read { latest_common, latest_common_by_name, latest, latest_xact, at };

struct Reply {
  ztf::Pose pose;
  Stamp stamp = 0;  // the oldest used
};

struct SystemOptions {
  Stamp cache = 0;               // how far history reaches back, ns
  unsigned max_samples = 0;      // of a link; tf2 has no such limit
  bool child_to_parent = false;  // the order in which frames are created and links written
};

class System {
 public:
  virtual ~System() = default;

  [[nodiscard]] virtual bool supports(Read read) const = 0;

  // Requires that every link was written; must be called before the first lookup.
  virtual void resolve_ids() {}

  // Looks up `count` requests one by one, by ids where the system has ids. Returns how many found a
  // transform; `last` is the last of these.
  virtual unsigned lookup(Read read, const Request* requests, unsigned count, Reply& last) = 0;

  // Sets `links` links in a row from `first` on, by names; in one transaction where the system has
  // transactions. Returns how many it stored.
  virtual unsigned write(FrameIndex first, unsigned links, Stamp stamp) = 0;
};

// `concurrency`: "optimistic", "2pl" or "giant". The forest must outlive the system.
std::unique_ptr<System> make_tree_system(const std::string& concurrency, const Forest& forest,
                                         const SystemOptions& options);
std::unique_ptr<System> make_tf2_system(const Forest& forest, const SystemOptions& options);

// Keeps a result from being optimised away.
inline void keep(const double& value) { asm volatile("" : : "m"(value) : "memory"); }

}  // namespace bench
