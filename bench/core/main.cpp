// bench_core NAME=VALUE... builds the systems under test, then obeys one command a line:
// "check", "trial" and "staleness", each with NAME=VALUE settings. Every answer is a line of JSON.
#include <malloc.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <future>
#include <iostream>
#include <sstream>
#include <utility>

#include "load.hpp"

namespace bench {

namespace {

// NAME=VALUE words. Getting one that is missing, or no number, throws std::exception.
struct Settings : std::map<std::string, std::string> {
  explicit Settings(std::istream& words) {
    for (std::string word; words >> word;)
      (*this)[word.substr(0, word.find('='))] = word.substr(word.find('=') + 1);
  }
  [[nodiscard]] double number(const std::string& name) const { return std::stod(at(name)); }
  [[nodiscard]] unsigned count(const std::string& name) const {
    return static_cast<unsigned>(std::stoul(at(name)));
  }
  [[nodiscard]] std::vector<std::string> list(const std::string& name) const {
    std::vector<std::string> items;
    std::istringstream rest(at(name));
    for (std::string item; std::getline(rest, item, ',');) items.push_back(item);
    return items;
  }
};

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

// Equal within 1e-9, and up to the rotation's sign. A NaN equals nothing.
bool equal(const Reply& a, const Reply& b) {
  const ztf::Pose &p = a.pose, &q = b.pose;
  const double sign = p.qx * q.qx + p.qy * q.qy + p.qz * q.qz + p.qw * q.qw < 0 ? -1 : 1;
  const auto near = [](double x, double y) { return std::abs(x - y) <= 1e-9; };
  return a.stamp == b.stamp && near(p.x, q.x) && near(p.y, q.y) && near(p.z, q.z) &&
         near(p.qx, sign * q.qx) && near(p.qy, sign * q.qy) && near(p.qz, sign * q.qz) &&
         near(p.qw, sign * q.qw);
}

class Bench {
 public:
  // links: see make_names(); samples, period_ns: each link's history; cache_s, max_samples,
  // child_to_parent: see SystemOptions; systems: those wanted. Prints which of them there are.
  explicit Bench(const Settings& settings)
      : names_(make_names(settings.count("links"))),
        samples_(settings.count("samples")),
        period_(static_cast<Stamp>(settings.number("period_ns"))),
        options_{static_cast<Stamp>(settings.number("cache_s") * 1e9),
                 settings.count("max_samples"), settings.count("child_to_parent") != 0} {
    const double before = resident_bytes();
    for (const std::string& name : settings.list("systems")) {
      if (name != "tf2") systems_[name].system = make_tree_system(name, names_, options_);
#ifdef BENCH_WITH_TF2
      if (name == "tf2") systems_[name].system = make_tf2_system(names_, options_);
#endif
    }
    std::vector<std::future<void>> filled;
    for (auto& entry : systems_)
      filled.push_back(std::async(std::launch::async, [&] { fill(entry.second); }));
    for (auto& one : filled) one.get();
    Metrics metrics{{"bytes_per_frame", (resident_bytes() - before) / size()}};
    for (const auto& entry : systems_) metrics[entry.first] = 1;
    print(metrics);
  }

  void obey(const std::string& line) {
    std::istringstream words(line);
    std::string command;
    words >> command;
    const Settings settings(words);
    if (command == "check") return check(settings);
    Instance& instance = systems_.at(settings.at("system"));
    const Read read = kReads.at(settings.at("read"));
    const double seconds = settings.number("seconds");
    if (command == "trial") {
      const Trial trial{settings.count("readers"),
                        settings.count("writers"),
                        read,
                        draw_of(settings),
                        settings.count("own_links") != 0,
                        period_,
                        seconds};
      const unsigned threads = trial.readers + trial.writers;
      if (threads > kMaxThreads || (trial.own_links && own_link(threads) > size()))
        throw std::invalid_argument("threads");
      return print(run_trial(instance, trial));
    }
    std::vector<double> rates_hz;
    for (const std::string& rate : settings.list("rates_hz")) rates_hz.push_back(std::stod(rate));
    print(measure_staleness(instance, read, rates_hz, seconds));
  }

 private:
  // Creates the frames in the wanted order, then adds the rest of the history, many links at once.
  void fill(Instance& instance) const {
    System& system = *instance.system;
    for (FrameIndex i = 1; i < size(); ++i) {
      const FrameIndex link = options_.child_to_parent ? size() - i : i;
      if (!system.write(link, 1, kStart)) throw std::runtime_error("not stored");
    }
    system.resolve_ids();
    for (unsigned sample = 1; sample < samples_; ++sample)
      for (FrameIndex link = 1; link < size(); link += 256)
        system.write(link, std::min(256u, size() - link), kStart + sample * period_);
    std::fill(std::begin(instance.next_stamp), std::end(instance.next_stamp), end());
  }

  [[nodiscard]] FrameIndex size() const { return static_cast<FrameIndex>(names_.size()); }
  [[nodiscard]] Stamp end() const { return kStart + samples_ * period_; }

  [[nodiscard]] Draw draw_of(const Settings& settings) const {
    const Draw draw{size(), settings.count("length"), (end() - kStart) / 4};
    if (draw.length < 1 || draw.length >= draw.frames) throw std::invalid_argument("length");
    return draw;
  }

  // Compares the answers of all systems to `count` requests; throws if they differ. With vary=1,
  // first writes a part of each second row, so that the links of a request differ in age.
  void check(const Settings& settings) {
    const Read read = kReads.at(settings.at("read"));
    const Draw draw = draw_of(settings);
    Random random(42);
    std::vector<Request> requests;
    for (unsigned i = 0; i < settings.count("count"); ++i) {
      requests.push_back(draw(random));
      if (settings.count("vary") && i % 2)
        for (auto& entry : systems_)
          entry.second.system->write(requests[i].target + 1, draw.length / 2 + 1, end() + 1000 * i);
    }
    for (const Request& request : requests) {
      std::vector<Reply> replies;
      for (auto& [name, instance] : systems_) {
        if (!instance.system->supports(read)) continue;
        if (!instance.system->lookup(read, &request, 1, replies.emplace_back()))
          throw std::runtime_error(name + ": no answer to " + settings.at("read"));
        if (!equal(replies.front(), replies.back()))
          throw std::runtime_error(name + ": another answer to " + settings.at("read"));
      }
    }
    print({});
  }

  const Names names_;
  const unsigned samples_;
  const Stamp period_;
  const SystemOptions options_;
  std::map<std::string, Instance> systems_;
};

}  // namespace

}  // namespace bench

int main(int count, char** values) try {
  std::stringstream words;
  for (int i = 1; i < count; ++i) words << values[i] << ' ';
  bench::Bench bench{bench::Settings(words)};
  for (std::string line; std::getline(std::cin, line);) bench.obey(line);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_core: %s\n", error.what());
  return 1;
}
