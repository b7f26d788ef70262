// A perception node: each point of a cloud has its own stamp, and is moved into the map.
//
// `cloud [TREE]` reads the tree of a server on this host; without a tree it makes its own.
#include <chrono>
#include <cstdio>
#include <vector>

#include "zenoh_tf/zenoh_tf.hpp"

namespace {

struct Point {
  double x, y, z;
};

// X_target_source applied to a point of source.
Point moved(const zenoh_tf::Pose& pose, const Point& p) {
  const double ux = 2 * (pose.qy * p.z - pose.qz * p.y);
  const double uy = 2 * (pose.qz * p.x - pose.qx * p.z);
  const double uz = 2 * (pose.qx * p.y - pose.qy * p.x);
  return {pose.x + p.x + pose.qw * ux + pose.qy * uz - pose.qz * uy,
          pose.y + p.y + pose.qw * uy + pose.qz * ux - pose.qx * uz,
          pose.z + p.z + pose.qw * uz + pose.qx * uy - pose.qy * ux};
}

// A lidar on a robot that drives 1 m in 0.1 s.
void publish(zenoh_tf::Tree& tree) {
  tree.set("base", "lidar", 0, {0.2, 0, 0.5, 0, 0, 0, 1}, "urdf", true);
  tree.set("map", "base", 0, {0, 0, 0, 0, 0, 0, 1}, "odometry");
  tree.set("map", "base", 100000000, {1, 0, 0, 0, 0, 0, 1}, "odometry");
}

}  // namespace

int main(int argc, char** argv) {
  try {
    zenoh_tf::Tree tree =
        argc > 1 ? zenoh_tf::Tree::open(argv[1], "", std::chrono::seconds(5)) : zenoh_tf::Tree();
    if (argc < 2) publish(tree);
    zenoh_tf::Pair lidar_in_map = tree.pair("map", "lidar");
    const zenoh_tf::Stamp end = lidar_in_map.lookup().stamp_ns;

    constexpr int kPoints = 1000;
    std::vector<Point> cloud(kPoints, Point{5, 0, 0});
    std::vector<zenoh_tf::Stamp> stamps(kPoints);
    for (int i = 0; i < kPoints; ++i) stamps[i] = end - 100000 * (kPoints - 1 - i) / 10;

    std::vector<zenoh_tf::Pose> poses;
    std::vector<std::int32_t> codes;
    lidar_in_map.lookup(stamps, poses, codes);
    int placed = 0;
    for (int i = 0; i < kPoints; ++i) {
      if (codes[i] != ZTF_OK) continue;
      cloud[i] = moved(poses[i], cloud[i]);
      ++placed;
    }
    std::printf("%d of %d points in the map, the last at x = %.3f m\n", placed, kPoints,
                cloud.back().x);
  } catch (const zenoh_tf::TransformException& error) {
    std::fprintf(stderr, "%s (%s)\n", error.what(), ztf_code_name(error.code()));
    return 1;
  }
}
