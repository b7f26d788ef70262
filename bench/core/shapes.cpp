#include <cstdio>
#include <random>

#include "crowd.hpp"
#include "json.hpp"
#include "measure.hpp"
#include "parts.hpp"

namespace bench {

namespace {

struct Shape {
  const char* name;
  Forest forest;
  std::vector<Pair> pairs;
};

// Any two frames of the body.
Shape humanoid_shape() {
  Shape shape{"humanoid, 60 links, two random frames", humanoid(), {}};
  std::mt19937 random(42);
  std::uniform_int_distribution<FrameIndex> any(0, shape.forest.size() - 1);
  while (shape.pairs.size() < 4096) {
    const Pair pair{any(random), any(random)};
    if (pair.target != pair.source) shape.pairs.push_back(pair);
  }
  return shape;
}

// The map, from the frames of random robots; or two robots, seen from each other.
Shape fleet_shape(const char* name, bool between_robots) {
  constexpr unsigned kRobots = 1000, kFrames = 30;
  Shape shape{name, fleet(kRobots), {}};
  std::mt19937 random(42);
  std::uniform_int_distribution<FrameIndex> any(0, shape.forest.size() - 2);
  while (shape.pairs.size() < 65536) {
    const FrameIndex a = any(random), b = any(random);
    if (!between_robots)
      shape.pairs.push_back({0, 1 + b});
    else if (a / kFrames != b / kFrames)
      shape.pairs.push_back({1 + a, 1 + b});
  }
  return shape;
}

}  // namespace

void run_shapes(Flags& flags) {
  const auto threads = flags.list<unsigned>("--threads", "1,2");
  const double seconds = flags.number("--seconds", 0.1);
  const auto repetitions = static_cast<unsigned>(flags.number("--repetitions", 5));
  const std::string file = flags.text("--json", "");
  flags.done();
  Json json;
  json.open().open("cells", '[');
  for (const Shape& shape :
       {humanoid_shape(), fleet_shape("fleet, 1,000 robots of 30 frames, from the map", false),
        fleet_shape("fleet, 1,000 robots of 30 frames, robot to robot", true)}) {
    std::fprintf(stderr, "%s\n", shape.name);
    const StoreOptions options{Stamp{3600} * 1'000'000'000, 16};
    const Stores stores = make_stores(shape.forest, options);
    fill(stores, shape.forest, options.samples);
    check_answers(stores, shape.pairs);
    std::map<std::pair<unsigned, std::pair<std::size_t, Read>>, std::vector<double>> rates;
    for (unsigned repetition = 0; repetition < repetitions; ++repetition)
      for (const unsigned count : threads)
        for (const Read kind : {Read::latest_xact, Read::common})
          for (std::size_t i = 0; i < stores.size(); ++i) {
            if (!stores[i]->can(kind)) continue;
            PausedClock clock;
            const Turn turn = run_crowd(*stores[i], {count, 0, kind, shape.pairs, 0, 0}, clock,
                                        seconds / 4, seconds);
            rates[{count, {i, kind}}].push_back(static_cast<double>(turn.reads) / turn.seconds);
          }
    for (const auto& [key, values] : rates) {
      json.line().open().add("shape", shape.name).add("threads", key.first);
      json.add("side", stores[key.second.first]->name());
      json.add("read", name_of(key.second.second)).add("reads_per_s", values).close();
    }
  }
  json.close().close();
  if (!file.empty()) json.write(file);
}

}  // namespace bench
