#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "crowd.hpp"
#include "json.hpp"
#include "measure.hpp"
#include "parts.hpp"

namespace bench {

namespace {

struct Cell {
  unsigned readers, writers;
  bool operator<(const Cell& other) const {
    return std::pair(writers, readers) < std::pair(other.writers, other.readers);
  }
};

// One side, asked in one way.
struct Series {
  std::size_t store;
  Read kind;
};

struct PaperSettings {
  std::set<Cell> cells;
  unsigned length, repetitions;
  unsigned samples;  // 0: as samples_for() has it
  double seconds, warm_up_s;
  std::vector<std::string> series;  // "SIDE/READ"; none: all
};

constexpr Read kKinds[] = {Read::latest_xact, Read::common};

bool wanted(const PaperSettings& settings, const Store& store, Read kind) {
  const auto& series = settings.series;
  const std::string name = store.name() + "/" + name_of(kind);
  return store.can(kind) &&
         (series.empty() || std::find(series.begin(), series.end(), name) != series.end());
}

// Of those alone there will be stores.
std::vector<std::string> sides_of(const PaperSettings& settings) {
  std::vector<std::string> sides;
  for (const std::string& name : settings.series) sides.push_back(name.substr(0, name.find('/')));
  return sides;
}

// Of each kind at least one, but for a ratio of 1. None where a ratio needs more threads.
std::set<Cell> cells_of(const std::vector<unsigned>& threads, const std::vector<double>& ratios) {
  std::set<Cell> cells;
  for (const unsigned count : threads)
    for (const double ratio : ratios) {
      if (count < 1 || count > kMaxThreads || ratio <= 0 || ratio > 1)
        throw std::invalid_argument("--threads from 1 to 64, --read-ratio above 0 and up to 1");
      const auto writers = static_cast<unsigned>(std::lround((1 - ratio) * count));
      if (ratio == 1)
        cells.insert({count, 0});
      else if (count > 1)
        cells.insert({count - std::max(1u, writers), std::max(1u, writers)});
    }
  return cells;
}

// How long a sample may be of use. A link of the small snake is set again within milliseconds; of
// the large one, by tf2, within a minute, and what one link has dropped none can be asked for.
Stamp cache_for(FrameIndex links) {
  return (links > 100'000 ? Stamp{3600} : Stamp{1}) * 1'000'000'000;
}

// Samples that a link keeps, as far as memory goes. With fewer, more reads at a common time find
// that a link has dropped the sample of that time.
std::uint32_t samples_for(FrameIndex links) { return links > 100'000 ? 16 : 64; }

// Random stretches of the snake, some with stamps of their own.
void check(const Stores& stores, FrameIndex links, unsigned length, Stamp after) {
  std::vector<Pair> pairs;
  for (FrameIndex i = 0; i < 200; ++i) {
    const auto top = static_cast<FrameIndex>(i * 7919ull % (links - length + 1));
    pairs.push_back({top, top + length});
    if (i % 2)
      for (const auto& store : stores)
        store->write(0, top, length / 2 + 1, after + 1000 * (i + Stamp{1}));
  }
  check_answers(stores, pairs);
}

void add_percentiles(Json& json, const char* key, const std::vector<Turn>& turns,
                     Histogram Turn::* histogram) {
  json.open(key);
  for (const auto& [name, percent] :
       {std::pair("p50", 50.0), std::pair("p99", 99.0), std::pair("p999", 99.9)}) {
    std::vector<double> values;
    for (const Turn& turn : turns) values.push_back((turn.*histogram).percentile(percent));
    json.add(name, values);
  }
  json.close();
}

void add_row(Json& json, const std::vector<Turn>& turns) {
  const auto list = [&](const char* key, auto&& value) {
    std::vector<double> values;
    for (const Turn& turn : turns) values.push_back(value(turn));
    json.add(key, values);
  };
  list("reads_per_s", [](const Turn& t) { return static_cast<double>(t.reads) / t.seconds; });
  list("writes_per_s", [](const Turn& t) { return static_cast<double>(t.writes) / t.seconds; });
  list("links_written_per_s",
       [](const Turn& t) { return static_cast<double>(t.links_written) / t.seconds; });
  list("unanswered_share", [](const Turn& t) {
    return static_cast<double>(t.unanswered) / static_cast<double>(t.reads + t.unanswered);
  });
  const auto per = [](std::uint64_t retries, std::uint64_t calls) {
    return calls == 0 ? 0.0 : static_cast<double>(retries) / static_cast<double>(calls);
  };
  list("restarts_per_read",
       [&](const Turn& t) { return per(t.read_restarts, t.reads + t.unanswered); });
  list("restarts_per_write", [&](const Turn& t) { return per(t.write_restarts, t.writes); });
  list("others_cores", [](const Turn& t) { return t.others_cores; });
  list("round_trip_ns", [](const Turn& t) { return t.round_trip_ns; });
  add_percentiles(json, "read_ns", turns, &Turn::read_ns);
  add_percentiles(json, "write_ns", turns, &Turn::write_ns);
  list("delay_oldest_s", [](const Turn& t) { return t.oldest_s / static_cast<double>(t.delays); });
  list("delay_mean_s", [](const Turn& t) { return t.mean_s / static_cast<double>(t.delays); });
}

// Whatever is compared comes one after the other, for the machine may become faster or slower: with
// writers all series of a cell; without, all cells of a series, that is, numbers of threads.
std::vector<std::pair<Cell, std::size_t>> order(const std::set<Cell>& cells, std::size_t series,
                                                bool writing) {
  std::vector<std::pair<Cell, std::size_t>> turns;
  for (const Cell& cell : cells)
    if ((cell.writers > 0) == writing)
      for (std::size_t s = 0; s < series; ++s) turns.push_back({cell, s});
  if (!writing) std::ranges::stable_sort(turns, {}, [](const auto& turn) { return turn.second; });
  return turns;
}

// All cells, for all series. Without writers first: then all links are of one age.
void measure(FrameIndex links, const std::string& direction, const PaperSettings& settings,
             Json& json) {
  std::fprintf(stderr, "%u links, %s direction\n", links, direction.c_str());
  const Forest forest = snake(links);
  const StoreOptions options{cache_for(links),
                             settings.samples ? settings.samples : samples_for(links),
                             direction == "same"};
  const Stores stores = make_stores(forest, options, sides_of(settings));
  const Stamp filled = fill(stores, forest, options.samples);
  check_answers(stores, {{0, settings.length}});
  std::vector<Series> all;
  for (const Read kind : kKinds)
    for (std::size_t i = 0; i < stores.size(); ++i)
      if (wanted(settings, *stores[i], kind)) all.push_back({i, kind});

  std::map<std::pair<Cell, std::size_t>, std::vector<Turn>> turns;
  for (const bool writing : {false, true}) {
    if (writing) check(stores, links, settings.length, filled);
    std::vector<PausedClock> clocks(stores.size());  // nothing is old when the first writer begins
    for (unsigned repetition = 0; repetition < settings.repetitions; ++repetition)
      for (const auto& [cell, s] : order(settings.cells, all.size(), writing)) {
        const Load load{cell.readers, cell.writers, all[s].kind, {}, links, settings.length};
        turns[{cell, s}].push_back(run_crowd(*stores[all[s].store], load, clocks[all[s].store],
                                             settings.warm_up_s, settings.seconds));
      }
  }
  for (const auto& [key, values] : turns) {
    const auto& [cell, s] = key;
    json.line().open();
    json.add("links", links).add("direction", direction);
    json.add("readers", cell.readers).add("writers", cell.writers);
    json.add("cache_s", static_cast<double>(options.cache) * 1e-9).add("samples", options.samples);
    json.add("pinned", pinned(cell.readers + cell.writers));
    json.add("side", stores[all[s].store]->name()).add("read", name_of(all[s].kind));
    add_row(json, values);
    json.close();
  }
}

}  // namespace

void run_paper(Flags& flags) {
  PaperSettings settings;
  const auto links = flags.list<FrameIndex>("--links", "1000,1000000");
  const auto threads = flags.list<unsigned>("--threads", "1,2,8");
  settings.cells = cells_of(threads, flags.list<double>("--read-ratio", "0.5,0.95,1"));
  const auto directions = flags.list<std::string>("--direction", "opposite");
  settings.length = static_cast<unsigned>(flags.number("--length", 16));
  settings.seconds = flags.number("--seconds", 0.3);
  settings.warm_up_s = std::min(1.0, settings.seconds / 4);
  settings.repetitions = static_cast<unsigned>(flags.number("--repetitions", 5));
  settings.samples = static_cast<unsigned>(flags.number("--samples", 0));
  settings.series = flags.list<std::string>("--series", "");
  const std::string file = flags.text("--json", "");
  flags.done();

  Json json;
  json.open();
  json.add("compiler", __VERSION__).add("length", settings.length);
  json.add("seconds", settings.seconds);
  json.open("cells", '[');
  for (const FrameIndex count : links)
    for (const std::string& direction : directions) {
      if (direction != "opposite" && direction != "same")
        throw std::invalid_argument("--direction must be opposite or same");
      if (settings.length < 1 || settings.length > std::min(count, 1000u))
        throw std::invalid_argument("--length must be from 1 to 1000, and to --links");
      measure(count, direction, settings, json);
    }
  json.close().close();
  if (!file.empty()) json.write(file);
}

}  // namespace bench
