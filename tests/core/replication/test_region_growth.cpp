// A region whose file grows with its tree, and what the host cannot give.
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>

#include "region_fixture.hpp"

using namespace ztf;

namespace {

std::uint64_t file_bytes(int descriptor) {
  struct stat status{};
  CHECK_EQ(::fstat(descriptor, &status), 0);
  return static_cast<std::uint64_t>(status.st_size);
}

// Samples of `frames` frames: more than the first steps of the file have room for.
void fill_histories(World& world, int frames, Stamp first, int samples) {
  for (int n = 0; n < frames; ++n) {
    std::vector<Set> sets;
    for (Stamp stamp = first; stamp < first + samples; ++stamp)
      sets.push_back({"root", nth("frame", n), stamp, at_x(n)});
    world.accept(sets);
  }
}

}  // namespace

TEST(the_file_grows_with_the_tree_and_a_reader_of_the_small_one_goes_on) {
  World world(shared({.cache_ns = 1'000'000}));
  fill_histories(world, 1, 0, 1);
  world.tree.begin_lease(kLong);
  const int descriptor = world.tree.descriptor();
  const SharedTree tree(descriptor);
  const std::uint64_t small = file_bytes(descriptor);
  CHECK(small < 4u << 20);  // the limits allow 48 MB
  const auto is_found = [&](int n, Stamp stamp) {
    Answer answer;
    const FrameId child = tree.find(nth("frame", n));
    tree.lookup({Op::at, tree.find("root"), child, stamp}, answer);
    return answer.failure.code == Code::ok && answer.pose.x == n;
  };
  CHECK(is_found(0, 0));
  fill_histories(world, 60, 0, 2000);
  CHECK(file_bytes(descriptor) >= small + 60 * 2000 * sizeof(Sample));
  for (int n = 0; n < 60; ++n) CHECK(is_found(n, 0) && is_found(n, 1999));
}

TEST(a_reader_touches_nothing_behind_the_end_of_the_file) {
  Bare bare;
  const int descriptor = bare.region.descriptor();
  RegionHeader& header = bare.region.header();
  Frame& frame = bare.region.frames()[2];
  const SharedTree tree(descriptor);
  // A ring, a table of names and a long name there, all within the mapping.
  const std::uint64_t end = file_bytes(descriptor);
  CHECK(end + (1 << 20) < header.bytes);
  header.used = header.bytes;
  auto* const behind = reinterpret_cast<std::byte*>(&header) + end;
  const auto distance_from = [&](const void* from) {
    return static_cast<std::uint64_t>(behind - static_cast<const std::byte*>(from));
  };
  frame.parent = 1;
  frame.count = 16;
  frame.latest.stamp = 100;
  reinterpret_cast<std::atomic<std::uint64_t>&>(frame.ring) = distance_from(&frame.latest) | 4;
  Answer answer;
  CHECK(unanswered([&] { tree.lookup({Op::at, 1, 2, 5}, answer); }) == Reason::unreadable);
  NameEntry& entry = bare.region.names()[2];
  entry.length = 200;
  entry.words[0] = distance_from(&entry);
  CHECK(unanswered([&] { (void)tree.name(2); }) == Reason::busy);
  header.names.table = distance_from(&header.names) | 6;
  CHECK_EQ(tree.find("frame1"), 0u);
}

TEST(a_write_is_rejected_if_the_host_has_no_memory_for_the_region) {
  World world(shared({.cache_ns = 1'000'000}));
  fill_histories(world, 1, 0, 1);
  world.tree.begin_lease(kLong);
  const SharedTree tree(world.tree.descriptor());
  // The file may not grow. Without the second call the system would end the process.
  rlimit before{};
  CHECK_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto previous = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit none{file_bytes(world.tree.descriptor()), before.rlim_max};
  CHECK_EQ(::setrlimit(RLIMIT_FSIZE, &none), 0);
  std::optional<Rejected> rejected;
  int stored = 0;
  for (; !rejected && stored < 100; ++stored) {
    std::vector<Set> sets;
    for (Stamp stamp = 0; stamp < 2000; ++stamp)
      sets.push_back({"root", nth("child", stored), stamp, at_x(stored)});
    rejected = world.commit(sets);
  }
  CHECK_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, previous);
  CHECK(rejected && rejected->code == Code::limit && rejected->field == "host_memory");
  // Nothing of it is left, the rest can be read, and once there is memory it continues.
  const std::string last = nth("child", stored - 1);
  CHECK_EQ(tree.find(last), 0u);
  Answer answer;
  tree.lookup({Op::latest_xact, tree.find("root"), tree.find(nth("frame", 0))}, answer);
  CHECK_EQ(answer.failure.code, Code::ok);
  fill_histories(world, 60, 0, 2000);
  CHECK(world.set("root", last, 1, at_x(3)) && tree.find(last) != 0);
}
