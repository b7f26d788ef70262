// The figures for people, line by line, and for programs.
#pragma once

#include <string>

#include "measure.hpp"

namespace bench {

// The line of column names, then one line for each case.
void print_head(const Sides& sides);
void print_line(const Sides& sides, const Figures& figures);

// Everything raw; throws where the file cannot be written.
void write_json(const std::string& path, const Sides& sides, const std::vector<Figures>& all);

}  // namespace bench
