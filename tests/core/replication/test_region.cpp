// A tree in a shared region: its lookups at another address, and what its readers refuse.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <random>

#include "region_fixture.hpp"

using namespace ztf;

namespace {

// Returns why the descriptor is refused; empty if it is not.
std::string refusal(int descriptor) {
  try {
    const SharedTree tree(descriptor);
  } catch (const RegionRefused& refused) {
    return refused.what();
  }
  return {};
}

void check_equal(const Answer& a, const Answer& b) {
  CHECK_EQ(a.failure.code, b.failure.code);
  if (a.failure.code != Code::ok) {
    CHECK_EQ(a.failure.frame, b.failure.frame);
    CHECK_EQ(a.failure.oldest, b.failure.oldest);
    CHECK_EQ(a.failure.newest, b.failure.newest);
    return;
  }
  CHECK_EQ(a.stamp, b.stamp);
  CHECK(distance(a.pose, b.pose) < 1e-9);  // not all are compiled for the same processor
}

// A chain with arms, histories of many lengths, a reparented and some static links.
void fill(World& world) {
  for (unsigned n = 1; n < 60; ++n) {
    const std::string parent = name_of(n < 30 ? n - 1 : n % 7);
    const bool is_static = n % 11 == 0;
    for (Stamp stamp = 0; stamp < static_cast<Stamp>(is_static ? 1 : n + 2); ++stamp)
      world.set(parent, name_of(n), 1000 + stamp * 10 + n % 3,
                some_pose(static_cast<int>(n + stamp)), is_static);
  }
  world.set("odom", "alone", 5);
}

}  // namespace

TEST_EACH_MODE(a_mapped_tree_answers_as_its_owner) {
  World world(shared({.cache_ns = 1'000'000, .concurrency = c}));
  fill(world);
  world.tree.begin_lease(kLong);
  const SharedTree first(world.tree.descriptor()), second(world.tree.descriptor());
  world.set(name_of(3), name_of(40), 3000, some_pose(9));  // after the mapping; reparents
  std::vector<Query> queries;
  for (unsigned i = 0; i < 64; ++i)
    for (const Op op : {Op::at, Op::latest_common, Op::latest_xact, Op::common_time, Op::full}) {
      Query q{op, first.find(name_of(i)), second.find(name_of(i * 7 % 64)), 1100 + i * 3};
      CHECK_EQ(q.target, world.tree.find(name_of(i)));
      q.fixed = first.find(name_of(2));
      q.source_stamp = 1050;
      queries.push_back(q);
    }
  std::vector<Answer> expected(queries.size()), batch(queries.size());
  ReadSet expected_reads, reads;
  world.tree.lookup_transaction(queries, expected, expected_reads);
  for (const SharedTree* tree : {&first, &second}) {
    for (std::size_t i = 0; i < queries.size(); ++i) {
      Answer answer;
      tree->lookup(queries[i], answer);
      check_equal(answer, expected[i]);
    }
    tree->lookup_transaction(queries, batch, reads);
    for (std::size_t i = 0; i < queries.size(); ++i) check_equal(batch[i], expected[i]);
    CHECK_EQ(reads.size(), expected_reads.size());
    for (std::size_t i = 0; i < reads.size(); ++i)
      CHECK_EQ(reads[i].version, expected_reads[i].version);
  }
  for (FrameId id = 1; id <= world.tree.size(); ++id) {
    CHECK(first.name(id) == world.tree.name(id));
    CHECK_EQ(first.parent(id, kNoStamp), world.tree.parent(id, kNoStamp));
    CHECK_EQ(first.parent(id, 1100), world.tree.parent(id, 1100));
    const FrameInfo mine = first.info(id), owners = world.tree.info(id);
    CHECK_EQ(mine.version, owners.version);
    CHECK_EQ(mine.samples, owners.samples);
    CHECK_EQ(mine.newest, owners.newest);
    std::vector<FrameId> chain, expected_chain;
    const Query q{Op::at, first.find(name_of(0)), id};
    CHECK_EQ(first.chain(q, chain).code, world.tree.chain(q, expected_chain).code);
    CHECK(chain == expected_chain);
  }
  CHECK_EQ(first.find("nobody"), 0u);
}

TEST(a_mapped_tree_samples_one_pair_at_many_times) {
  World world(shared({.cache_ns = 1'000'000}));
  fill(world);
  world.tree.begin_lease(kLong);
  const SharedTree tree(world.tree.descriptor());
  std::vector<Query> queries;
  for (Stamp stamp = 990; stamp < 1400; stamp += 3)
    queries.push_back({Op::at, tree.find(name_of(0)), tree.find(name_of(28)), stamp});
  std::vector<Answer> expected(queries.size()), answers(queries.size());
  world.tree.lookup_batch(queries, expected);
  tree.lookup_batch(queries, answers);
  for (std::size_t i = 0; i < queries.size(); ++i) check_equal(answers[i], expected[i]);
}

TEST(velocities_are_the_owners) {
  World world(shared());
  for (Stamp stamp = 0; stamp < 10; ++stamp)
    world.set("map", "base", stamp * 1'000'000'000, at_x(2.0 * static_cast<double>(stamp)));
  world.tree.begin_lease(kLong);
  const SharedTree tree(world.tree.descriptor());
  const FrameId map = tree.find("map"), base = tree.find("base");
  VelocityAnswer answer;
  tree.lookup_velocity({base, map, map, base, kNoStamp, 1'000'000'000, {}}, answer);
  CHECK_EQ(answer.failure.code, Code::ok);
  CHECK_NEAR(answer.twist.linear.x, 2.0, 1e-9);
}

TEST(nothing_is_answered_without_a_lease) {
  World world(shared());
  world.set("map", "base", 5, at_x(1));
  const SharedTree tree(world.tree.descriptor());
  const Query query{Op::latest_xact, tree.find("map"), tree.find("base")};
  Answer answer;
  ReadSet reads;
  std::vector<FrameId> frames;
  const auto check_all = [&](std::optional<Reason> expected) {
    CHECK(unanswered([&] { tree.lookup(query, answer); }) == expected);
    CHECK(unanswered([&] { tree.lookup_transaction({&query, 1}, {&answer, 1}, reads); }) ==
          expected);
    CHECK(unanswered([&] { (void)tree.chain(query, frames); }) == expected);
    CHECK(unanswered([&] { (void)tree.parent(query.source, kNoStamp); }) == expected);
    CHECK(unanswered([&] { (void)tree.info(query.source); }) == expected);
  };
  check_all(Reason::lapsed);
  world.tree.begin_lease(kLong);
  check_all(std::nullopt);
  world.tree.begin_lease(1);
  check_all(Reason::lapsed);
  world.tree.begin_lease(kLong);
  check_all(std::nullopt);
  world.tree.begin_lease(0);
  check_all(Reason::lapsed);
}

TEST(a_lease_that_nears_its_end_counts_to_the_end) {
  World world(shared());
  world.set("map", "base", 5, at_x(1));
  const SharedTree tree(world.tree.descriptor());
  // Within the margin of the coarse clock, the exact one decides.
  const std::int64_t begin = monotonic_ns();
  world.tree.begin_lease(90'000'000);
  const auto reason = unanswered([&] { tree.check_lease(); });
  if (monotonic_ns() - begin < 80'000'000) CHECK(!reason);
}

TEST(the_tree_of_an_owner_that_has_ended_is_not_believed) {
  auto world = std::make_unique<World>(shared());
  world->set("map", "base", 5, at_x(1));
  world->tree.begin_lease(kLong);
  const SharedTree tree(world->tree.descriptor());
  const Query query{Op::latest_xact, tree.find("map"), tree.find("base")};
  world.reset();
  Answer answer;
  CHECK(unanswered([&] { tree.lookup(query, answer); }) == Reason::lapsed);
}

TEST(a_frame_whose_writer_never_ends_is_left_to_the_owner) {
  Bare bare;
  const SharedTree tree(bare.region.descriptor());
  bare.region.frames()[2].version.lock_and_begin_write();
  Answer answer;
  ReadSet reads;
  for (const Op op : {Op::at, Op::latest_common, Op::latest, Op::latest_xact, Op::full}) {
    const Query query{op, 1, 2, 5, 1, 5};
    CHECK(unanswered([&] { tree.lookup(query, answer); }) == Reason::busy);
    CHECK(unanswered([&] { tree.lookup_transaction({&query, 1}, {&answer, 1}, reads); }) ==
          Reason::busy);
  }
  CHECK(unanswered([&] { (void)tree.parent(2, kNoStamp); }) == Reason::busy);
  CHECK(unanswered([&] { (void)tree.info(2); }) == Reason::busy);
  // A lock alone does not keep readers off.
  bare.region.frames()[3].version.lock_writer();
  CHECK(!unanswered([&] { (void)tree.info(3); }));
}

TEST(what_cannot_be_read_is_refused_with_a_reason) {
  CHECK_EQ(refusal(Bare().region.descriptor()), "");
  const auto refusal_after = [](auto&& change) {
    Bare bare;
    change(bare.region.header());
    return refusal(bare.region.descriptor());
  };
  const auto mentions = [](const std::string& text, const char* part) {
    CHECK(text.find(part) != std::string::npos);
  };
  mentions(refusal_after([](RegionHeader& h) { h.magic += 1; }), "not a region");
  mentions(refusal_after([](RegionHeader& h) { h.layout_version += 1; }), "layout 4");
  mentions(refusal_after([](RegionHeader& h) { h.layout_hash ^= 1; }), "layout 3");
  mentions(refusal_after([](RegionHeader& h) { h.bytes = 4096; }), "size");
  mentions(refusal_after([](RegionHeader& h) { h.bytes = ~0ull << 12; }), "mapped");
  mentions(refusal_after([](RegionHeader& h) { h.boot_id[0] ^= 1; }), "boot");
  mentions(refusal_after([](RegionHeader& h) { h.time_namespace ^= 1; }), "clock");
  mentions(refusal_after([](RegionHeader& h) { h.max_depth = ~0u; }), "limits");
  mentions(refusal_after([](RegionHeader& h) { h.concurrency = 3; }), "limits");
  mentions(refusal_after([](RegionHeader& h) { h.max_authorities += 1 << 16; }), "limits");
  mentions(refusal_after([](RegionHeader& h) { h.max_frames = 1u << 30; }), "outside");
  mentions(refusal_after([](RegionHeader& h) { h.frames += 64; }), "outside");
  mentions(refusal_after([](RegionHeader& h) { h.frames = ~0ull << 7; }), "outside");
  mentions(refusal_after([](RegionHeader& h) { h.events = h.bytes; }), "outside");
  mentions(refusal_after([](RegionHeader& h) { h.names.entries = h.bytes; }), "outside");

  int pipes[2];
  CHECK_EQ(::pipe(pipes), 0);
  mentions(refusal(pipes[0]), "sealed");
  ::close(pipes[0]), ::close(pipes[1]);
  const int file = ::memfd_create("test", MFD_ALLOW_SEALING | MFD_CLOEXEC);
  CHECK_EQ(::ftruncate(file, 1 << 20), 0);
  mentions(refusal(file), "sealed");
  CHECK_EQ(::fcntl(file, F_ADD_SEALS, F_SEAL_SHRINK), 0);
  mentions(refusal(file), "not a region");
  ::close(file);
}

TEST(nobody_can_write_to_a_region_through_its_descriptor) {
  Bare bare;
  const int descriptor = bare.region.descriptor();
  CHECK(::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0) == MAP_FAILED);
  void* const mapped = ::mmap(nullptr, 4096, PROT_READ, MAP_SHARED, descriptor, 0);
  CHECK(mapped != MAP_FAILED);
  CHECK(::mprotect(mapped, 4096, PROT_READ | PROT_WRITE) != 0);
  ::munmap(mapped, 4096);
  CHECK(::pwrite(descriptor, "x", 1, 0) < 0);
  CHECK(::ftruncate(descriptor, 4096) < 0);
  CHECK(::ftruncate(descriptor, std::int64_t{1} << 40) < 0);
  CHECK(::fallocate(descriptor, 0, 0, 1 << 24) < 0);
  CHECK(::fallocate(descriptor, FALLOC_FL_KEEP_SIZE, 0, 1 << 24) < 0);
  CHECK(::fallocate(descriptor, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, 4096) < 0);
}

TEST(random_bytes_neither_crash_a_reader_nor_hold_it_up) {
  for (unsigned seed = 1; seed <= 12; ++seed) {
    Bare bare;
    Region& region = bare.region;
    RegionHeader& header = region.header();
    // Pages that are touched; what the arena has used makes room for rings that are in bounds.
    (void)region.allocate(1 << 20, 1 << 20);
    const std::uint64_t used = header.used, entries = header.names.entries;
    const SharedTree tree(region.descriptor());
    std::mt19937_64 random(seed);
    auto* const words = reinterpret_cast<std::uint64_t*>(&header);
    for (std::uint64_t i = kHeaderBytes / 8; i < used / 8; ++i) {
      // Some words are small, so that ids, counts and distances are in bounds more often.
      const std::uint64_t word = random();
      words[i] = word % 4 == 0 ? word >> (32 + word / 4 % 28) : word;
    }
    // Most frames have no writer, so that few reads wait and most reach what is wrong.
    for (FrameId id = 0; id < 64; ++id)
      if (random() % 32 != 0) {
        const Version version = random();
        region.frames()[id].version.unlock_unchanged(version & ~Version{3});
      }
    header.names.table = random();
    header.names.size = static_cast<std::uint32_t>(random());
    header.ever_reparented = seed % 2 != 0;
    if (seed % 3 == 0) header.used = random();
    CHECK_EQ(header.names.entries, entries);

    Answer answer;
    ReadSet reads;
    std::vector<FrameId> frames;
    const auto id = [&] { return static_cast<FrameId>(random() % 64); };
    for (int i = 0; i < 400; ++i) {
      std::vector<Query> queries;
      const auto op = static_cast<Op>(random() % kOps);
      for (int row = 0; row < 10; ++row)
        queries.push_back({i % 2 ? op : Op::at, id(), id(), static_cast<Stamp>(random()), id()});
      std::fill(queries.begin() + 1, queries.end(), queries[0]);
      std::vector<Answer> answers(queries.size());
      (void)unanswered([&] { tree.lookup(queries[0], answer); });
      (void)unanswered([&] { tree.lookup_batch(queries, answers); });
      (void)unanswered([&] { tree.lookup_transaction(queries, answers, reads); });
      (void)unanswered([&] { (void)tree.chain(queries[0], frames); });
      (void)unanswered([&] { (void)tree.parent(id(), static_cast<Stamp>(random())); });
      (void)unanswered([&] { (void)tree.info(id()); });
      (void)unanswered([&] { (void)tree.name(static_cast<FrameId>(random())); });
      (void)unanswered([&] { (void)tree.authority(static_cast<FrameId>(random() % 9)); });
      CHECK(tree.find(name_of(static_cast<unsigned>(i))) <= tree.options().max_frames);
    }
  }
}

// Readers map the region, and could defeat the randomisation of addresses.
TEST(a_region_holds_no_address_of_its_owner) {
  World world(shared());
  const auto frame = [](int n) {
    return "a_frame_whose_name_does_not_fit_into_its_entry_" + nth("", n);
  };
  for (int n = 0; n < 40; ++n)
    for (Stamp stamp = 1; stamp < 40; ++stamp) world.set("map", frame(n), stamp);
  for (int n = 0; n < 40; ++n) (void)world.remove(frame(n), true);
  for (int n = 0; n < 30; ++n) world.set("map", frame(n + 100), 1);  // uses free ones again
  const auto& header = world.tree.state().region.header();
  const std::uint64_t begin = reinterpret_cast<std::uintptr_t>(&header), end = begin + header.bytes;
  const auto* const words = reinterpret_cast<const std::uint64_t*>(&header);
  std::size_t addresses = 0;
  for (std::uint64_t i = 0; i < header.used / 8; ++i)
    addresses += words[i] >= begin && words[i] < end;
  CHECK_EQ(addresses, 0u);
}

TEST(a_rate_that_no_history_has_is_not_followed) {
  Bare bare;
  const SharedTree tree(bare.region.descriptor());
  Frame& frame = bare.region.frames()[2];
  frame.parent = 1;
  frame.count = 1000;
  frame.oldest_stamp = 0;
  frame.latest.stamp = 1'000'000;
  Answer answer;
  for (const double rate : {1.0, 1e18, 1e300, static_cast<double>(INFINITY)}) {
    frame.samples_per_ns = rate;
    tree.lookup({Op::at, 1, 2, 500}, answer);  // any answer, but no undefined conversion
    CHECK(answer.failure.code == Code::ok || answer.failure.frame == 2);
  }
}

TEST(any_lease_is_one_that_has_ended_or_not) {
  Bare bare;
  const SharedTree tree(bare.region.descriptor());
  using Limits = std::numeric_limits<std::int64_t>;
  for (const std::int64_t lease : {Limits::min(), Limits::min() + 1, std::int64_t{-1}}) {
    bare.region.header().lease_ns = lease;
    CHECK(unanswered([&] { tree.check_lease(); }) == Reason::lapsed);
  }
  bare.region.header().lease_ns = Limits::max();
  CHECK(!unanswered([&] { tree.check_lease(); }));
}
