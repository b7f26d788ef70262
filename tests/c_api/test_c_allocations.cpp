// No lookup without names in the error allocates.
#include <cstdlib>
#include <new>

#include "owner.hpp"
#include "zenoh_tf/zenoh_tf.hpp"

using namespace ztf;

namespace {

thread_local std::size_t allocations = 0;

}  // namespace

// Not inlined: GCC would take them for a mismatch of malloc() and delete.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  ++allocations;
  if (void* const memory = std::malloc(bytes)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

TEST(lookups_allocate_nothing) {
  const SocketFolder folder;
  Owner owner(folder, "a1");
  zenoh_tf::Tree own;
  for (int n = 0; n < 30; ++n)
    for (const Stamp stamp : {1000, 2000, 3000}) {
      const Pose p = some_pose(n + static_cast<int>(stamp));
      owner.world.set(nth("frame", n), nth("frame", n + 1), stamp, p);
      own.set(nth("frame", n), nth("frame", n + 1), stamp, {p.x, p.y, p.z, p.qx, p.qy, p.qz, p.qw});
    }
  const zenoh_tf::Tree shared = zenoh_tf::Tree::open("main", folder.path);
  CHECK(allocations > 0);  // they are counted
  for (const zenoh_tf::Tree* each : std::initializer_list<const zenoh_tf::Tree*>{&own, &shared}) {
    ztf_tree* const tree = each->get();
    ztf_frame frames[2];
    CHECK_EQ(int{ztf_resolve(tree, "frame0", &frames[0], nullptr)}, int{ZTF_OK});
    CHECK_EQ(int{ztf_resolve(tree, "frame30", &frames[1], nullptr)}, int{ZTF_OK});
    zenoh_tf::Answer answer;
    ztf_pose poses[100];
    std::int32_t codes[100];
    std::int64_t stamps[100];
    const ztf_frame to[2] = {frames[0], frames[0]}, from[2] = {frames[1], frames[1]};
    const std::size_t before = allocations;
    for (int i = 0; i < 1000; ++i) {
      const Stamp stamp = 900 + 3 * i;  // some are out of range
      (void)ztf_lookup(tree, "frame0", "frame30", stamp, nullptr, &answer, nullptr);
      (void)ztf_lookup(tree, "frame30", "frame0", kNoStamp, nullptr, &answer, nullptr);
      (void)ztf_lookup(tree, "frame30", "a frame whose name is not short", stamp, nullptr, &answer,
                       nullptr);
      (void)ztf_lookup_full(tree, "frame3", stamp, "frame20", 2000, "frame9", nullptr, &answer,
                            nullptr);
      (void)ztf_latest(tree, "frame0", "frame30", &answer, nullptr);
      (void)ztf_latest_xact(tree, "frame0", "frame30", &answer, nullptr);
      (void)ztf_can(tree, "frame0", "frame30", stamp, nullptr);
      (void)ztf_lookup_ref(tree, ZTF_AT, &frames[0], &frames[1], stamp, &answer, nullptr);
      (void)ztf_lookup_xact(tree, ZTF_LATEST_XACT, to, from, 2, 0, poses, stamps, nullptr);
      for (int k = 0; k < 100; ++k) stamps[k] = stamp + k;
      (void)ztf_lookup_times(tree, &frames[0], &frames[1], stamps, 100, poses, codes, nullptr);
    }
    CHECK_EQ(allocations, before);
  }
}
