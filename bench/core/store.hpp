// One of the systems that are compared, holding a forest of any shape.
//
// Thread safety: read(), write() and newest_stamps() from any thread, a thread number from one at a
// time.
#pragma once

#include <memory>

#include "forest.hpp"
#include "side.hpp"

namespace bench {

enum class Read { common, latest, latest_xact };
const char* name_of(Read kind);

struct StoreOptions {
  Stamp cache;            // how far history reaches back
  std::uint32_t samples;  // no more of a link's are kept; tf2 knows no such limit
  bool reversed = false;  // create the frames, and write links, from child to parent
};

class Store {
 public:
  virtual ~Store() = default;

  [[nodiscard]] virtual std::string name() const = 0;
  [[nodiscard]] virtual bool can(Read kind) const = 0;

  // The newest stamp, or the oldest of the newest, of what was used; false where there is no
  // answer. Lookups by ids where the system has ids.
  virtual bool read(unsigned thread, Read kind, FrameIndex target, FrameIndex source,
                    Stamp& oldest) = 0;
  // The same with its answer, for the check.
  virtual bool ask(Read kind, FrameIndex target, FrameIndex source, Reply& reply) = 0;

  // Sets a link by names, as the API has it; any link of the forest.
  virtual void set(FrameIndex link, Stamp stamp) = 0;
  // Sets the links below `top`, each on the one before; in one transaction where the system has
  // transactions. How many were stored.
  virtual unsigned write(unsigned thread, FrameIndex top, unsigned links, Stamp stamp) = 0;

  // The mean of the newest stamps of the links below `top`, less kStart; NaN where one has none.
  virtual double mean_newest(unsigned thread, FrameIndex top, unsigned links) = 0;
};

using Stores = std::vector<std::unique_ptr<Store>>;

// With every link set once, at kStart. `concurrency`: "optimistic", "2pl" or "giant".
std::unique_ptr<Store> make_tree_store(const std::string& concurrency, const Forest& forest,
                                       const StoreOptions& options);
// Null where this program was built without tf2.
std::unique_ptr<Store> make_tf2_store(const Forest& forest, const StoreOptions& options);

// All of them, or those whose names are given; tf2 comes last, if it is there.
Stores make_stores(const Forest& forest, const StoreOptions& options,
                   const std::vector<std::string>& names = {});
// Sets every link `times` times, all at the same stamps after kStart; the last one is returned.
Stamp fill(const Stores& stores, const Forest& forest, unsigned times);

// Throws where answers differ, or where there is none, between random frames of the pairs.
struct Pair {
  FrameIndex target, source;
};
void check_answers(const Stores& stores, const std::vector<Pair>& pairs);

template <class Set>
void set_all(const Forest& forest, bool reversed, Set&& set) {
  for (FrameIndex k = 0; k < forest.size(); ++k) {
    const FrameIndex link = reversed ? forest.size() - 1 - k : k;
    if (forest.parents[link] != link) set(link);
  }
}

}  // namespace bench
