// bench_core [--threads 1,2] [--repetitions 7] [--block SECONDS] [--only TEXT] [--json FILE]
//
// Lookups at depth 4 and single sets, each concurrency control by turns with the real tf2. The
// answers of all are compared before anything is timed.
#include <cstdio>
#include <sstream>
#include <stdexcept>

#include "measure.hpp"
#include "report.hpp"

namespace {

struct Arguments {
  bench::Settings settings{{1, 2}, 7, 0.05};
  std::string only, json;
};

Arguments parse(int count, char** values) {
  Arguments arguments;
  for (int i = 1; i < count; i += 2) {
    const std::string flag = values[i];
    if (i + 1 == count) throw std::invalid_argument("no value for " + flag);
    const std::string value = values[i + 1];
    if (flag == "--threads") {
      arguments.settings.threads.clear();
      std::istringstream list(value);
      for (std::string item; std::getline(list, item, ',');)
        arguments.settings.threads.push_back(static_cast<unsigned>(std::stoul(item)));
      for (const unsigned threads : arguments.settings.threads)
        if (threads < 1 || threads > bench::kMaxThreads)
          throw std::invalid_argument("--threads must be from 1 to 64");
    } else if (flag == "--repetitions") {
      arguments.settings.repetitions = std::max(1, std::stoi(value));
    } else if (flag == "--block") {
      arguments.settings.block_s = std::stod(value);
    } else if (flag == "--only") {
      arguments.only = value;
    } else if (flag == "--json") {
      arguments.json = value;
    } else {
      throw std::invalid_argument("no such flag: " + flag);
    }
  }
  return arguments;
}

}  // namespace

int main(int count, char** values) try {
  const Arguments arguments = parse(count, values);
  bench::Sides sides;
  for (const char* concurrency : {"optimistic", "2pl", "giant"})
    sides.push_back(bench::make_tree_side(concurrency));
  if (auto tf2 = bench::make_tf2_side())
    sides.push_back(std::move(tf2));
  else
    std::printf("built without tf2 (Debian: libtf2-dev, libboost-thread-dev): no comparison\n");
  bench::check_answers(sides);
  bench::print_head(sides);
  std::vector<bench::Figures> all;
  for (const bench::Case& what : bench::cases())
    for (const unsigned threads : arguments.settings.threads) {
      if (std::string(what.name).find(arguments.only) == std::string::npos) continue;
      all.push_back(bench::measure(sides, what, threads, arguments.settings));
      bench::print_line(sides, all.back());
    }
  if (!arguments.json.empty()) bench::write_json(arguments.json, sides, all);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_core: %s\n", error.what());
  return 1;
}
