// bench_core NAME=VALUE... builds the system under test, then obeys one command a line: "answers",
// "trial" and "staleness", each with NAME=VALUE settings. Every answer is a line of JSON.
#include <malloc.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <iostream>
#include <sstream>
#include <utility>

#include "load.hpp"

namespace bench {

namespace {

const std::map<std::string, Read> kReads{{"latest-common", Read::latest_common},
                                         {"latest-common-by-name", Read::latest_common_by_name},
                                         {"latest-xact", Read::latest_xact},
                                         {"at", Read::at}};

void print(const Metrics& metrics) {
  const char* separator = "";
  std::cout << '{';
  for (const auto& [name, value] : metrics)
    std::cout << std::exchange(separator, ", ") << '"' << name << "\": " << value;
  std::cout << '}' << std::endl;
}

// The bytes of this process in the machine's memory.
double resident_bytes() {
  malloc_trim(0);
  double all, pages;
  std::ifstream("/proc/self/statm") >> all >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

class Bench {
 public:
  // Settings: those of the systems, of which "tf2" is one; links, see make_names(); samples and
  // period_ns, each link's history; offset_ns, by which each link's stamps are later than those of
  // the link before; grasp, whether a frame beside the links changes its parent.
  explicit Bench(const Settings& settings)
      : names_(make_names(settings.count("links"))),
        samples_(settings.count("samples")),
        period_(static_cast<Stamp>(settings.number("period_ns"))),
        offset_(static_cast<Stamp>(settings.number("offset_ns"))) {
    const double before = resident_bytes();
    if (settings.at("system") != "tf2") instance_.system = make_tree_system(names_, settings);
#ifdef BENCH_WITH_TF2
    if (settings.at("system") == "tf2") instance_.system = make_tf2_system(names_, settings);
#endif
    Metrics metrics;  // none without the system
    if (instance_.system) {
      fill(settings.count("child_to_parent") != 0);
      if (settings.count("grasp") != 0) instance_.system->grasp(end());
      metrics["bytes_per_frame"] = (resident_bytes() - before) / size();
    }
    print(metrics);
  }

  void obey(const std::string& line) {
    std::istringstream words(line);
    std::string command;
    words >> command;
    const Settings settings(words);
    const Read read = kReads.at(settings.at("read"));
    if (command == "answers") return answers(read, settings);
    const double seconds = settings.number("seconds");
    if (command == "staleness") {
      std::vector<double> rates_hz;
      std::istringstream rates(settings.at("rates_hz"));
      for (std::string rate; std::getline(rates, rate, ',');) rates_hz.push_back(std::stod(rate));
      return print(measure_staleness(instance_, read, rates_hz, seconds));
    }
    print(run_trial(instance_,
                    {settings.count("readers"), settings.count("writers"), read, draw_of(settings),
                     settings.count("own_links") != 0, period_, seconds}));
  }

 private:
  // Creates the frames in the wanted order, then adds the rest of the history, many links at once.
  void fill(bool child_to_parent) {
    System& system = *instance_.system;
    for (FrameIndex i = 1; i < size(); ++i) {
      const FrameIndex link = child_to_parent ? size() - i : i;
      if (!system.write(link, 1, kStart + link * offset_)) throw std::runtime_error("not stored");
    }
    system.resolve_ids();
    const unsigned together = offset_ == 0 ? 256 : 1;
    for (unsigned sample = 1; sample < samples_; ++sample)
      for (FrameIndex link = 1; link < size(); link += together)
        system.write(link, std::min(together, size() - link),
                     kStart + sample * period_ + link * offset_);
    std::fill(std::begin(instance_.next_stamp), std::end(instance_.next_stamp), end());
  }

  [[nodiscard]] FrameIndex size() const { return static_cast<FrameIndex>(names_.size()); }
  [[nodiscard]] Stamp end() const { return kStart + samples_ * period_; }

  [[nodiscard]] Draw draw_of(const Settings& settings) const {
    return {size(), settings.count("length"), (end() - kStart) / 4};
  }

  // Prints the poses and stamps that answer 500 requests, the same for every system. With vary=1,
  // first writes a part of each second row, so that the links of a request differ in age.
  void answers(Read read, const Settings& settings) {
    const Draw draw = draw_of(settings);
    Random random(42);
    std::vector<Request> requests;
    for (unsigned i = 0; i < 500; ++i) {
      requests.push_back(draw(random));
      if (settings.count("vary") && i % 2)
        instance_.system->write(requests[i].target + 1, draw.length / 2 + 1, end() + 1000 * i);
    }
    const char* separator = "[[";
    for (const Request& request : requests) {
      Reply reply;
      if (!instance_.system->lookup(read, &request, 1, reply))
        throw std::runtime_error("no answer to " + settings.at("read"));
      const auto& [x, y, z, qx, qy, qz, qw] = reply.pose;
      std::cout << std::exchange(separator, "], [");
      for (const double value : {x, y, z, qx, qy, qz, qw}) std::cout << value << ", ";
      std::cout << reply.stamp;
    }
    std::cout << "]]" << std::endl;
  }

  const Names names_;
  const unsigned samples_;
  const Stamp period_, offset_;
  Instance instance_;
};

}  // namespace

}  // namespace bench

int main(int count, char** values) try {
  std::stringstream words;
  for (int i = 1; i < count; ++i) words << values[i] << ' ';
  std::cout.precision(17);  // distinguishes every double from its neighbours
  bench::Bench bench{bench::Settings(words)};
  for (std::string line; std::getline(std::cin, line);) bench.obey(line);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_core: %s\n", error.what());
  return 1;
}
