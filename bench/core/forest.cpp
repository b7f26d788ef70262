#include "forest.hpp"

#include <array>
#include <utility>

namespace bench {

namespace {

std::string numbered(std::string name, std::size_t i) {
  return std::move(name.append(std::to_string(i)));
}

}  // namespace

FrameIndex Forest::add(std::string name, FrameIndex parent) {
  names.push_back(std::move(name));
  parents.push_back(parent);
  return size() - 1;
}

Forest snake(FrameIndex links) {
  Forest forest;
  for (FrameIndex i = 0; i <= links; ++i) forest.add(numbered("link", i), i == 0 ? 0 : i - 1);
  return forest;
}

Forest humanoid() {
  Forest forest;
  const FrameIndex body = forest.add("body", 0);
  for (const std::string limb : {"head", "left_arm", "right_arm", "left_leg", "right_leg"}) {
    FrameIndex parent = body;
    for (int i = 1; i <= 12; ++i) parent = forest.add(numbered(limb, i), parent);
  }
  return forest;
}

Forest fleet(unsigned robots) {
  Forest forest;
  const FrameIndex map = forest.add("map", 0);
  for (unsigned robot = 0; robot < robots; ++robot) {
    const std::string prefix = numbered("robot", robot) + "/";
    const FrameIndex odom = forest.add(prefix + "odom", map);
    const FrameIndex base = forest.add(prefix + "base_link", odom);
    for (int chain = 0; chain < 4; ++chain) {
      FrameIndex parent = base;
      for (int i = 0; i < 7; ++i)
        parent = forest.add(prefix + numbered(numbered("chain", chain) + "_", i), parent);
    }
  }
  return forest;
}

const ztf::Pose& pose_at(FrameIndex link, Stamp stamp) {
  constexpr int kClasses = 16, kSteps = 64;
  static const auto table = [] {
    std::array<std::array<ztf::Pose, kSteps>, kClasses> result;
    for (int i = 0; i < kClasses; ++i)
      for (int k = 0; k < kSteps; ++k) result[i][k] = pose_of(i, k);
    return result;
  }();
  const auto step = static_cast<int>((stamp >> 20) & (2 * kSteps - 1));  // about a millisecond
  return table[link % kClasses][step < kSteps ? step : 2 * kSteps - 1 - step];
}

}  // namespace bench
