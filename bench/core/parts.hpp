// What this program can measure; each part takes its own flags.
#pragma once

#include "flags.hpp"

namespace bench {

// Lookups at depth 4 and single sets, each concurrency control by turns with the real tf2.
//   --threads 1,2  --repetitions 15  --block SECONDS  --only TEXT  --json FILE
void run_lookups(Flags& flags);

// Readers and writers on a snake of links: the workload of Kawashima, "data-driven robotics", 2022.
//   --links 1000,1000000  --threads 1,2,8  --read-ratio 0.5,0.95,1  --length 16
//   --direction opposite,same  --seconds 0.3  --repetitions 5
//   --series SIDE/READ,...  --samples N  --json FILE
void run_paper(Flags& flags);

// Lookups in trees as they are: a humanoid, a fleet.
//   --threads 1,2  --seconds 0.1  --repetitions 5  --json FILE
void run_shapes(Flags& flags);

// Sources at fixed rates, and how old the data is that a lookup uses.
//   --seconds 10  --json FILE
void run_staleness(Flags& flags);

// Bytes for a frame, by the samples that it holds.
//   --frames 100000  --samples 1,2,4,8,16,64  --json FILE
void run_memory(Flags& flags);

}  // namespace bench
