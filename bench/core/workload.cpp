#include "workload.hpp"

#include <random>

namespace bench {

ztf::Pose pose_of(std::size_t link, int sample) {
  const double angle = 0.3 + 0.1 * static_cast<double>(link) + 0.002 * sample;
  const double sine = std::sin(angle / 2);
  // The axis (2, 3, 6) / 7, its components shifted from link to link.
  const double axis[3] = {2.0 / 7, 3.0 / 7, 6.0 / 7};
  return {0.5 + 0.25 * static_cast<double>(link),
          -1.0 + 0.001 * sample,
          0.125 * static_cast<double>(link % 3) + 0.0005 * sample,
          axis[link % 3] * sine,
          axis[(link + 1) % 3] * sine,
          axis[(link + 2) % 3] * sine,
          std::cos(angle / 2)};
}

std::vector<Link> links() {
  std::vector<Link> all;
  for (int i = 0; i < 4; ++i) {
    const std::string parent = std::to_string(i), child = std::to_string(i + 1);
    all.push_back({"link" + parent, "link" + child});
    all.push_back({"staggered" + parent, "staggered" + child, i * kPeriod / 5});
  }
  for (const std::string side : {"left", "right"}) {
    all.push_back({"link0", side + "_shoulder"});
    all.push_back({side + "_shoulder", side + "_hand"});
  }
  return all;
}

Link link_to_set(unsigned thread) { return {"link0", "set" + std::to_string(thread)}; }

std::vector<Case> cases() {
  return {
      {"latest common, ids", Kind::common_ids, "link0", "link4", 10, 35},
      {"latest common, names", Kind::common_names, "link0", "link4", 4},
      {"at a time, ids", Kind::at_ids, "link0", "link4", 10},
      {"siblings, latest common, ids", Kind::common_ids, "left_hand", "right_hand"},
      {"siblings, at a time, ids", Kind::at_ids, "left_hand", "right_hand"},
      {"stamps differ, latest common, ids", Kind::common_ids, "staggered0", "staggered4"},
      {"set, full history", Kind::set, "", ""},
  };
}

const std::vector<Stamp>& times() {
  static const std::vector<Stamp> drawn = [] {
    std::mt19937_64 random(42);
    std::uniform_int_distribution<Stamp> middle(kCache / 4, 3 * kCache / 4);
    std::vector<Stamp> result(kTimes);
    for (Stamp& time : result) time = kStart + middle(random);
    return result;
  }();
  return drawn;
}

}  // namespace bench
