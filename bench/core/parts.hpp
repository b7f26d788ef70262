// What this program can measure; each part takes its own flags.
#pragma once

#include "flags.hpp"

namespace bench {

// Lookups at depth 4 and single sets, each concurrency control by turns with the real tf2.
//   --threads 1,2  --repetitions 7  --block SECONDS  --only TEXT  --json FILE
void run_lookups(Flags& flags);

// Readers and writers on a snake of links: the workload of Kawashima, "data-driven robotics", 2022.
//   --links 1000,1000000  --threads 1,2,8  --read-ratio 0.5,0.95,1  --length 16
//   --direction opposite,same  --seconds SECONDS  --repetitions 5  --samples N  --json FILE
void run_paper(Flags& flags);

}  // namespace bench
