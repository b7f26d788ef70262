// A name table, and an arena of rings, with memory of their own.
//
// Thread safety: NameTable's and RingArena's.
#pragma once

#include "names/table.hpp"
#include "records/layout.hpp"
#include "records/ring_arena.hpp"

namespace ztf {

struct OwnedRegion {
  explicit OwnedRegion(std::uint32_t max_names)
      : region(Options{.max_frames = max_names, .max_authorities = 1}) {}
  Region region;
};

class OwnedNames : OwnedRegion, public NameTable {
 public:
  explicit OwnedNames(std::uint32_t max_names)
      : OwnedRegion(max_names),
        NameTable(region.header().names, region.names(), max_names, region) {}
};

class OwnedArena : OwnedRegion, public RingArena {
 public:
  OwnedArena() : OwnedRegion(2), RingArena(region, 0) {}
};

}  // namespace ztf
