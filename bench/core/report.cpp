#include "report.hpp"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <stdexcept>

namespace bench {

namespace {

bool has_tf2(const Sides& sides) { return sides.back()->name() == "tf2"; }

double bar_of(const Figures& figures) {
  if (figures.threads == 1) return figures.what.bar;
  return figures.threads == 2 ? figures.what.bar_of_two : 0;
}

// Pair by pair: a repetition's rates stand beside each other in time.
std::vector<double> ratios(const std::vector<double>& rates, const std::vector<double>& reference) {
  std::vector<double> result;
  for (std::size_t i = 0; i < rates.size(); ++i) result.push_back(rates[i] / reference[i]);
  return result;
}

void list(std::ofstream& out, const std::vector<double>& values) {
  for (std::size_t i = 0; i < values.size(); ++i) out << (i ? ", " : "[") << values[i];
  out << "]";
}

}  // namespace

void print_head(const Sides& sides) {
  std::printf("%-36s %7s", "medians, millions of calls a second", "threads");
  for (const auto& side : sides) std::printf(" %10s", side->name().c_str());
  if (has_tf2(sides))
    for (std::size_t i = 0; i + 1 < sides.size(); ++i)
      std::printf("  %20s", (sides[i]->name() + "/tf2 [all]").c_str());
  std::printf("\n");
}

void print_line(const Sides& sides, const Figures& figures) {
  std::printf("%-36s %7u", figures.what.name, figures.threads);
  for (const auto& rates : figures.rates) std::printf(" %10.3f", median(rates) / 1e6);
  if (has_tf2(sides)) {
    for (std::size_t i = 0; i + 1 < sides.size(); ++i) {
      const std::vector<double> times = ratios(figures.rates[i], figures.rates.back());
      const auto [low, high] = std::minmax_element(times.begin(), times.end());
      char text[64];
      std::snprintf(text, sizeof text, "%.2f [%.2f-%.2f]", median(times), *low, *high);
      std::printf("  %20s", text);
    }
    const double bar = bar_of(figures);
    if (bar > 0) {
      const double reached = median(ratios(figures.rates.front(), figures.rates.back()));
      std::printf("  bar %g: %s", bar, reached >= bar ? "reached" : "MISSED");
    }
  }
  std::printf("\n");
  std::fflush(stdout);
}

void write_json(const std::string& path, const Sides& sides, const std::vector<Figures>& all) {
  std::ofstream out(path);
  out << "{\"compiler\": \"" << __VERSION__
      << "\",\n \"unit\": \"calls per second\",\n \"cases\": [";
  for (std::size_t k = 0; k < all.size(); ++k) {
    out << (k ? ",\n  " : "\n  ") << "{\"case\": \"" << all[k].what.name
        << "\", \"threads\": " << all[k].threads;
    if (bar_of(all[k]) > 0) out << ", \"bar\": " << bar_of(all[k]);
    for (std::size_t i = 0; i < sides.size(); ++i) {
      out << ", \"" << sides[i]->name() << "\": ";
      list(out, all[k].rates[i]);
    }
    out << "}";
  }
  out << "\n ]}\n";
  out.close();
  if (!out) throw std::runtime_error("cannot write " + path);
}

}  // namespace bench
