#include <cstdio>

#include "measure.hpp"
#include "parts.hpp"
#include "report.hpp"

namespace bench {

void run_lookups(Flags& flags) {
  Settings settings;
  settings.threads = flags.list<unsigned>("--threads", "1,2");
  settings.repetitions = static_cast<int>(flags.number("--repetitions", 15));
  settings.block_s = flags.number("--block", 0.05);
  const std::string only = flags.text("--only", ""), json = flags.text("--json", "");
  flags.done();
  for (const unsigned threads : settings.threads)
    if (threads < 1 || threads > kMaxThreads)
      throw std::invalid_argument("--threads must be from 1 to 64");

  Sides sides;
  for (const char* concurrency : {"optimistic", "2pl", "giant"})
    sides.push_back(make_tree_side(concurrency));
  if (auto tf2 = make_tf2_side())
    sides.push_back(std::move(tf2));
  else
    std::printf("built without tf2 (Debian: libtf2-dev, libboost-thread-dev): no comparison\n");
  check_answers(sides);
  print_head(sides);
  std::vector<Figures> all;
  for (const Case& what : cases())
    for (const unsigned threads : settings.threads) {
      if (std::string(what.name).find(only) == std::string::npos) continue;
      all.push_back(measure(sides, what, threads, settings));
      print_line(sides, all.back());
    }
  if (!json.empty()) write_json(json, sides, all);
}

}  // namespace bench
