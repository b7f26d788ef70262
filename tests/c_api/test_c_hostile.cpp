// What C's readers do with a server of another layout or of another user, and with a damaged tree.
#include <optional>
#include <random>
#include <set>

#include "../core/replication/region_fixture.hpp"
#include "owner.hpp"
#include "zenoh_tf/zenoh_tf.hpp"

using namespace ztf;

namespace {

// Returns the error of opening the tree, or of a lookup in it.
template <class Body>
std::pair<int, std::string> thrown(Body&& body) {
  try {
    body();
  } catch (const zenoh_tf::TransformException& error) {
    return {error.code(), error.what()};
  }
  return {ZTF_OK, ""};
}

// Calls every function that reads by name, and those by reference; returns the codes.
std::set<int> read_all(const ztf_tree* tree, const ztf_frame* frames, std::mt19937_64& random) {
  const std::string a = name_of(random() % 21), b = name_of(random() % 21), c = name_of(1);
  const Stamp stamp = random() % 2 ? 1005 : static_cast<Stamp>(random());
  const ztf_frame &f = frames[random() % 20], &g = frames[random() % 20];
  const ztf_frame many[2]{f, g}, others[2]{g, f};
  zenoh_tf::Answer answer;
  ztf_error error{};
  error.size = sizeof error;
  ztf_frame found;
  ztf_pose poses[2];
  std::int64_t stamps[2]{stamp, 1005};
  std::int32_t row_codes[2];
  ztf_frame_info info{};
  info.size = sizeof info;
  char buffer[4096];
  std::size_t needed;
  std::set<int> codes{
      ztf_lookup(tree, a.c_str(), b.c_str(), stamp, nullptr, &answer, &error),
      ztf_lookup_full(tree, a.c_str(), stamp, b.c_str(), 1005, c.c_str(), nullptr, &answer, &error),
      ztf_latest(tree, a.c_str(), b.c_str(), &answer, &error),
      ztf_latest_xact(tree, a.c_str(), b.c_str(), &answer, &error),
      ztf_common_time(tree, a.c_str(), b.c_str(), stamps, &error),
      ztf_resolve(tree, a.c_str(), &found, &error),
      ztf_lookup_times(tree, &f, &g, stamps, 2, poses, row_codes, &error),
      ztf_frames(tree, buffer, sizeof buffer, &needed, &error),
      ztf_parent(tree, a.c_str(), stamp, buffer, sizeof buffer, &needed, &error),
      ztf_chain(tree, a.c_str(), b.c_str(), stamp, buffer, sizeof buffer, &needed, &error),
      ztf_info(tree, a.c_str(), &info, &error)};
  (void)ztf_can(tree, a.c_str(), b.c_str(), stamp, nullptr);
  for (const ztf_op op : {ZTF_AT, ZTF_LATEST_COMMON, ZTF_LATEST, ZTF_LATEST_XACT}) {
    codes.insert(ztf_lookup_ref(tree, op, &f, &g, stamp, &answer, &error));
    codes.insert(ztf_lookup_xact(tree, op, many, others, 2, stamp, poses, stamps, &error));
  }
  return codes;
}

}  // namespace

TEST(damaged_memory_gives_an_answer_or_a_typed_error) {
  std::set<int> codes;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    Bare bare;
    (void)bare.region.allocate(1 << 20, 1 << 20);
    RegionHeader& header = bare.region.header();
    const SocketFolder folder;
    const HandOver socket(folder, "a1", "main", bare.region.descriptor());
    const zenoh_tf::Tree tree = zenoh_tf::Tree::open("main", folder.path);
    ztf_frame frames[20];
    for (unsigned n = 0; n < 20; ++n)
      (void)ztf_resolve(tree.get(), name_of(n).c_str(), frames + n, nullptr);
    std::mt19937_64 random(seed);
    auto* const words = reinterpret_cast<std::uint64_t*>(&header);
    const unsigned one_in = seed % 3 == 0 ? 1 : seed % 3 == 1 ? 8 : 64;
    for (std::uint64_t i = kHeaderBytes / 8; i < header.used / 8; ++i) {
      const std::uint64_t word = random();
      if (random() % one_in == 0) words[i] = word % 4 == 0 ? word >> (32 + word / 4 % 28) : word;
    }
    for (FrameId id = 0; id < 64; ++id)
      if (random() % 32 != 0)
        bare.region.frames()[id].version.unlock_unchanged(random() & ~Version{3});
    if (seed % 2 != 0) header.names.size = static_cast<std::uint32_t>(random());
    for (int i = 0; i < 100; ++i) codes.merge(read_all(tree.get(), frames, random));
  }
  for (const int code : codes) CHECK(std::string(ztf_code_name(code)) != "unknown");
  CHECK(codes.contains(ZTF_OK));
  CHECK(codes.size() > 3);
}

TEST(a_server_of_another_layout_is_refused_until_another_one_is_there) {
  const SocketFolder folder;
  const auto other = [&](auto&& body) {
    Bare bare;
    bare.region.header().layout_version += 1;
    const HandOver socket(folder, "b2", "main", bare.region.descriptor());
    body();
  };
  std::pair<int, std::string> why;
  other([&] { why = thrown([&] { zenoh_tf::Tree::open("main", folder.path); }); });
  CHECK_EQ(why.first, int{ZTF_PROTOCOL});
  CHECK(why.second.find("layout") != std::string::npos);
  std::optional<Owner> owner(std::in_place, folder, "a1");
  owner->world.set("map", "base", 1000, at_x(1));
  const zenoh_tf::Tree tree = zenoh_tf::Tree::open("main", folder.path);
  owner.reset();
  other([&] {
    do why = thrown([&] { tree.latest("map", "base"); });
    while (why.first == ZTF_SERVER_UNAVAILABLE);  // until it was found
  });
  CHECK_EQ(why.first, int{ZTF_PROTOCOL});
  CHECK(why.second.find("layout") != std::string::npos);
  owner.emplace(folder, "c3");
  owner->world.set("map", "base", 1000, at_x(2));
  while (tree.server().mapped < 2) std::this_thread::yield();
  CHECK_EQ(tree.latest("map", "base").pose.x, 2);
}

TEST(the_socket_of_another_user_is_refused) {
  if (::geteuid() != 0) return;  // only root can be another user
  const SocketFolder folder;
  ::chmod(folder.path.c_str(), 01777);  // others may add names, as in /tmp
  CHECK_EQ(::seteuid(65534), 0);
  std::optional<Owner> foreign(std::in_place, folder, "a1");
  CHECK_EQ(::seteuid(0), 0);
  CHECK_EQ(thrown([&] { zenoh_tf::Tree::open("main", folder.path); }).first,
           int{ZTF_ACCESS_DENIED});
  const Owner own(folder, "b2");  // the other one does not hide it
  CHECK_EQ(std::string(zenoh_tf::Tree::open("main", folder.path).server().instance), "b2");
}
