// bench_core PART [--flag VALUE]...; the parts and their flags stand in parts.hpp.
//
// The answers of all sides are compared before anything is timed.
#include <cstdio>
#include <exception>
#include <map>

#include "parts.hpp"

int main(int count, char** values) try {
  const std::map<std::string, void (*)(bench::Flags&)> parts{
      {"lookups", bench::run_lookups}, {"paper", bench::run_paper},
      {"shapes", bench::run_shapes},   {"staleness", bench::run_staleness},
      {"memory", bench::run_memory},
  };
  const auto part = parts.find(count > 1 ? values[1] : "");
  if (part == parts.end()) {
    std::string names;
    for (const auto& [name, run] : parts) names += " " + name;
    throw std::invalid_argument("the first argument must be one of" + names);
  }
  bench::Flags flags(count - 2, values + 2);
  part->second(flags);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_core: %s\n", error.what());
  return 1;
}
