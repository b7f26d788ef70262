#include <malloc.h>
#include <unistd.h>

#include <fstream>

#include "json.hpp"
#include "parts.hpp"
#include "store.hpp"

namespace bench {

namespace {

// Of this process, in bytes: what its data takes in the machine's memory now.
double resident() {
  malloc_trim(0);
  std::ifstream statm("/proc/self/statm");
  double all, pages;
  statm >> all >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

// What was freed before is used again: each size is measured in a store of its own, from zero.
double bytes_with(const std::string& side, const Forest& forest, unsigned samples) {
  const double before = resident();
  const Stores stores = make_stores(forest, {Stamp{3600} * 1'000'000'000, 1u << 16}, {side});
  if (stores.empty()) return 0;
  fill(stores, forest, samples - 1);
  return resident() - before;
}

}  // namespace

void run_memory(Flags& flags) {
  const auto frames = static_cast<FrameIndex>(flags.number("--frames", 100'000));
  const auto samples = flags.list<unsigned>("--samples", "1,2,4,8,16,64");
  const std::string file = flags.text("--json", "");
  flags.done();
  const Forest forest = snake(frames);
  Json json;
  json.open().add("frames", frames).open("rows", '[');
  for (const char* side : {"optimistic", "tf2"})
    for (const unsigned count : samples) {
      const double bytes = bytes_with(side, forest, count);
      if (bytes == 0) continue;
      json.line().open().add("side", side).add("samples", count);
      json.add("bytes_per_frame", bytes / frames).close();
    }
  json.close().close();
  if (!file.empty()) json.write(file);
}

}  // namespace bench
