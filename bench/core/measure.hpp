// Measures sides by turns, so that whatever else the machine does meets all of them.
#pragma once

#include <memory>
#include <vector>

#include "side.hpp"

namespace bench {

using Sides = std::vector<std::unique_ptr<Side>>;

struct Settings {
  std::vector<unsigned> threads;
  int repetitions;
  double block_s;  // how long one side runs in one repetition
};

struct Figures {
  Case what;
  unsigned threads;
  // [side][repetition], calls per second over all threads; equal repetitions are neighbours in
  // time.
  std::vector<std::vector<double>> rates;
};

// Throws where answers differ by more than 1e-9 (rotations up to sign) or in stamp.
void compare(const Reply& a, const Reply& b, const std::string& what);
// Compares all sides' answers to all that will be asked.
void check_answers(const Sides& sides);

Figures measure(const Sides& sides, const Case& what, unsigned threads, const Settings& settings);

double median(std::vector<double> values);

}  // namespace bench
