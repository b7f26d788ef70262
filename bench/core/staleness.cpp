#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

#include "crowd.hpp"
#include "json.hpp"
#include "measure.hpp"
#include "parts.hpp"

namespace bench {

namespace {

using Clock = std::chrono::steady_clock;

struct Source {
  const char* link;
  double rate_hz;
};

// From the map down to the gripper; the joints come from one driver each.
constexpr Source kSources[] = {
    {"map to odom", 10}, {"odom to base", 50}, {"base to arm", 200}, {"arm to gripper", 200}};
constexpr FrameIndex kLinks = std::size(kSources);

// How old what an answer rests on is, link by link.
struct Ages {
  std::vector<double> of_links[kLinks];
  std::vector<double> oldest;
};

double percentile(std::vector<double> values, double percent) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(static_cast<double>(values.size() - 1) * percent / 100)];
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

// Puts a link's transform into all stores, at its rate, each stamped with the time of the put.
void publish(const Stores& stores, const PausedClock& clock, FrameIndex link, double rate_hz,
             const std::atomic<bool>& stop) {
  const auto period = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / rate_hz));
  // Sources know nothing of each other: none starts when another does.
  Clock::time_point next = Clock::now() + period * (link + 1) / (kLinks + 1);
  while (!stop.load()) {
    std::this_thread::sleep_until(next);
    const Stamp now = clock.now();
    for (const auto& store : stores) store->set(link, now);
    next += period;
  }
}

}  // namespace

void run_staleness(Flags& flags) {
  const double seconds = flags.number("--seconds", 10);
  const std::string file = flags.text("--json", "");
  flags.done();
  const Forest forest = snake(kLinks);
  const Stores stores =
      make_stores(forest, {Stamp{10} * 1'000'000'000, 1u << 16}, {"optimistic", "tf2"});
  check_answers(stores, {{0, kLinks}});

  PausedClock clock;
  clock.resume();
  std::atomic<bool> stop{false};
  std::vector<std::thread> sources;
  for (FrameIndex link = 0; link < kLinks; ++link)
    sources.emplace_back(
        [&, link] { publish(stores, clock, link + 1, kSources[link].rate_hz, stop); });

  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  constexpr Read kKinds[] = {Read::common, Read::latest, Read::latest_xact};
  std::map<std::pair<std::size_t, Read>, Ages> all;
  const Clock::time_point end =
      Clock::now() + std::chrono::nanoseconds(static_cast<std::int64_t>(seconds * 1e9));
  for (unsigned n = 0; Clock::now() < end; ++n) {
    // At no fixed distance to any of the rates.
    std::this_thread::sleep_for(std::chrono::microseconds(500 + n * 7919 % 1000));
    for (std::size_t i = 0; i < stores.size(); ++i)
      for (const Read kind : kKinds) {
        if (!stores[i]->can(kind)) continue;
        Ages& ages = all[{i, kind}];
        const Stamp now = clock.now();
        const auto age = [&](Stamp stamp) { return static_cast<double>(now - stamp) * 1e-9; };
        Stamp oldest;
        if (!stores[i]->read(0, kind, 0, kLinks, oldest)) continue;
        ages.oldest.push_back(age(oldest));
        for (FrameIndex link = 0; link < kLinks; ++link) {
          // At a common time, all links are taken as they were then.
          Stamp stamp = oldest;
          if (kind == Read::common || stores[i]->read(0, kind, link, link + 1, stamp))
            ages.of_links[link].push_back(age(stamp));
        }
      }
  }
  stop = true;
  for (std::thread& source : sources) source.join();

  Json json;
  json.open().add("seconds", seconds).open("rows", '[');
  for (const auto& [key, ages] : all) {
    const auto row = [&](const char* link, double rate_hz, const std::vector<double>& values) {
      json.line().open().add("side", stores[key.first]->name());
      json.add("read", name_of(key.second)).add("link", link).add("rate_hz", rate_hz);
      json.add("samples", static_cast<double>(values.size())).add("mean_s", mean(values));
      json.add("p50_s", percentile(values, 50)).add("p99_s", percentile(values, 99)).close();
    };
    for (FrameIndex link = 0; link < kLinks; ++link)
      row(kSources[link].link, kSources[link].rate_hz, ages.of_links[link]);
    row("oldest used", 0, ages.oldest);
  }
  json.close().close();
  if (!file.empty()) json.write(file);
}

}  // namespace bench
