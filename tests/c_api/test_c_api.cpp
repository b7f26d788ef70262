// The C functions and the C++ classes beside the core's own lookups: a tree of this process, and
// one of a server.
#include <random>

#include "by_name/errors.hpp"
#include "by_name/lookup.hpp"
#include "owner.hpp"
#include "zenoh_tf/zenoh_tf.hpp"

using namespace ztf;

namespace {

constexpr std::chrono::nanoseconds kLong = std::chrono::minutes(2);

Pose pose_of(const ztf_pose& p) { return {p.x, p.y, p.z, p.qx, p.qy, p.qz, p.qw}; }
ztf_pose c_pose(const Pose& p) { return {p.x, p.y, p.z, p.qx, p.qy, p.qz, p.qw}; }

ztf_pose at(double x) { return {x, 0, 0, 0, 0, 0, 1}; }

ztf_error new_error() {
  ztf_error error{};
  error.size = sizeof error;
  return error;
}

// Calls body() and returns the code that it throws.
template <class Body>
ztf_code thrown(Body&& body) {
  try {
    body();
  } catch (const zenoh_tf::TransformException& error) {
    return error.code();
  }
  return ZTF_OK;
}

// The same random links in the core's tree and in C's.
void fill(World& world, zenoh_tf::Tree* tree, std::mt19937& random) {
  for (int n = 1; n < 40; ++n) {
    const std::string parent = nth("f", n < 25 ? n / 2 : 100 + n % 3), child = nth("f", n);
    const bool is_static = n % 9 == 0;
    const int samples = is_static ? 1 : static_cast<int>(random() % 40 + 1);
    for (int i = 0; i < samples; ++i) {
      const Stamp stamp = 1000 + i * 100 + n % 5;
      const Pose pose = some_pose(static_cast<int>(random() % 50));
      world.set(parent, child, stamp, pose, is_static);
      if (tree) tree->set(parent, child, stamp, c_pose(pose), "", is_static);
    }
  }
}

struct Question {
  Op op;
  std::string target, source, fixed;
  Stamp stamp, source_stamp;
};

Question random_question(std::mt19937& random) {
  const auto frame = [&] { return nth("f", random() % 43); };  // some do not exist
  const auto stamp = [&] { return Stamp(900 + random() % 4500); };
  const auto op = static_cast<Op>(random() % kOps);
  const bool timed = op == Op::at || (op == Op::full && random() % 4 != 0);
  return {op, frame(), frame(), frame(), timed ? stamp() : kNoStamp, timed ? stamp() : kNoStamp};
}

ztf_code ask(const zenoh_tf::Tree& tree, const Question& q, zenoh_tf::Answer& answer,
             ztf_error& error) {
  const char *target = q.target.c_str(), *source = q.source.c_str();
  switch (q.op) {
    case Op::latest:
      return ztf_latest(tree.get(), target, source, &answer, &error);
    case Op::latest_xact:
      return ztf_latest_xact(tree.get(), target, source, &answer, &error);
    case Op::common_time:
      return ztf_common_time(tree.get(), target, source, &answer.stamp_ns, &error);
    case Op::full:
      return ztf_lookup_full(tree.get(), target, q.stamp, source, q.source_stamp, q.fixed.c_str(),
                             nullptr, &answer, &error);
    default:
      return ztf_lookup(tree.get(), target, source, q.stamp, nullptr, &answer, &error);
  }
}

// Checks what a tree answers against what the core's tree does.
void check_question(const World& world, const zenoh_tf::Tree& tree, const Question& q) {
  NamedQuery query{
      {.op = q.op, .stamp = q.stamp, .source_stamp = q.source_stamp}, q.target, q.source, q.fixed};
  Answer expected;
  lookup(world.tree, query, expected);
  zenoh_tf::Answer answer;
  ztf_error error = new_error();
  const ztf_code code = ask(tree, q, answer, error);
  CHECK_EQ(int{code}, static_cast<int>(expected.failure.code));
  if (code != ZTF_OK) {
    const LookupNote note{.may_wait = q.op < Op::latest || q.op == Op::full};
    const Rejected facts = lookup_error(world.tree, expected.failure, query, note);
    CHECK_EQ(std::string(error.message), facts.message);
    CHECK_EQ(std::string(error.frame), facts.frame);
    CHECK_EQ(std::string(error.parent_frame), facts.parent);
    CHECK_EQ(std::string(error.target_root), facts.target_root);
    CHECK_EQ(error.newest_stamp_ns, facts.newest);
    return;
  }
  CHECK_EQ(answer.stamp_ns, expected.stamp);
  if (q.op == Op::common_time) return;
  CHECK(distance(pose_of(answer.pose), expected.pose) < 1e-12);
  CHECK_EQ(answer.gap_ns, expected.gap);
  if (q.op == Op::latest || q.op == Op::latest_xact)
    CHECK_EQ(answer.newest_stamp_ns, expected.newest);
}

// The same through references.
void check_reference(const World& world, const zenoh_tf::Tree& tree, const Question& q) {
  if (q.op > Op::latest_xact) return;
  ztf_frame target, source;
  ztf_error error = new_error();
  for (const auto& [name, frame] : {std::pair{&q.target, &target}, {&q.source, &source}})
    if (const ztf_code code = ztf_resolve(tree.get(), name->c_str(), frame, &error)) {
      CHECK_EQ(int{code}, int{ZTF_LOOKUP});
      CHECK_EQ(world.id(*name), 0u);
      return;
    }
  const Answer expected = world.ask(q.op, q.target, q.source, q.stamp);
  const auto op = static_cast<ztf_op>(q.op);
  zenoh_tf::Answer answer;
  ztf_pose pose, row;
  std::int64_t stamp;
  const ztf_code code = ztf_lookup_ref(tree.get(), op, &target, &source, q.stamp, &answer, &error);
  CHECK_EQ(int{code}, static_cast<int>(expected.failure.code));
  CHECK_EQ(
      int{ztf_lookup_xact(tree.get(), op, &target, &source, 1, q.stamp, &pose, &stamp, &error)},
      int{code});
  std::int32_t row_code = ZTF_OK;
  if (q.op == Op::at) {
    CHECK_EQ(
        int{ztf_lookup_times(tree.get(), &target, &source, &q.stamp, 1, &row, &row_code, &error)},
        int{ZTF_OK});
    CHECK_EQ(row_code, int{code});
  }
  if (code != ZTF_OK) return;
  CHECK_EQ(answer.stamp_ns, expected.stamp);
  CHECK_EQ(stamp, expected.stamp);
  CHECK(distance(pose_of(answer.pose), expected.pose) < 1e-12);
  CHECK(distance(pose_of(pose), expected.pose) < 1e-12);
  if (q.op == Op::at) CHECK(distance(pose_of(row), expected.pose) < 1e-9);
}

}  // namespace

TEST(random_questions_are_answered_as_by_the_core) {
  std::mt19937 random(1);
  const SocketFolder folder;
  Owner owner(folder, "a1");
  zenoh_tf::Options options;
  options.cache_time_ns = 1'000'000'000;
  zenoh_tf::Tree own(options);
  fill(owner.world, &own, random);
  const zenoh_tf::Tree shared = zenoh_tf::Tree::open("main", folder.path);
  for (int i = 0; i < 20'000; ++i) {
    const Question question = random_question(random);
    for (const zenoh_tf::Tree* tree : std::initializer_list<const zenoh_tf::Tree*>{&own, &shared}) {
      check_question(owner.world, *tree, question);
      check_reference(owner.world, *tree, question);
    }
  }
  CHECK_EQ(own.frames().size(), shared.frames().size());
  for (const zenoh_tf::Tree* tree : std::initializer_list<const zenoh_tf::Tree*>{&own, &shared}) {
    CHECK_EQ(tree->parent("f5"), "f2");
    CHECK_EQ(tree->parent("f0"), "");
    CHECK_EQ(tree->chain("f3", "f5").size(), 4u);
    CHECK_EQ(tree->info("f9").flags, int{ZTF_STATIC});
    CHECK_EQ(std::string(tree->info("f9").parent), "f4");
    CHECK_EQ(tree->info("f0").samples, 0u);
  }
}

TEST(writes_are_stored_or_refused) {
  zenoh_tf::Options options;
  options.cache_time_ns = 1000;
  zenoh_tf::Tree tree(options);
  const ztf_pose pose{1, 2, 3, 0, 0, 0, 1};
  CHECK(tree.set("map", "base", 10'000, pose, "odometry"));
  CHECK(!tree.set("map", "base", 5'000, pose, "odometry"));  // too old
  CHECK_EQ(std::string(tree.info("base").authority), "odometry");
  const auto invalid = int{ZTF_INVALID_ARGUMENT};
  CHECK_EQ(int{thrown([&] { tree.set("base", "map", 10'000, pose); })}, invalid);  // a cycle
  CHECK_EQ(int{thrown([&] { tree.set("map", "base", kNoStamp, pose); })}, invalid);
  CHECK_EQ(int{thrown([&] { tree.set("map", "base", 11'000, {0, 0, 0, 0, 0, 0, 2}); })}, invalid);
  CHECK_EQ(int{thrown([&] { tree.set(nullptr, "base", 11'000, pose); })}, invalid);
  const std::vector<ztf_transform> rows{{"base", "arm", 10'000, pose},
                                        {"arm", "base", 10'000, pose}};
  CHECK_EQ(int{thrown([&] { tree.set_xact(rows); })}, invalid);
  CHECK_EQ(tree.frames().size(), 2u);  // nothing of it is stored
  tree.set_xact({{"base", "arm", 10'000, pose}, {"arm", "tool", 10'000, pose}});
  CHECK_EQ(tree.lookup("map", "tool").pose.x, 3);
  CHECK_EQ(int{thrown([&] { tree.remove_frame("base"); })}, invalid);
  CHECK_EQ(int{thrown([&] { tree.remove_frame("none"); })}, int{ZTF_LOOKUP});
  tree.remove_frame("base", true);
  CHECK_EQ(tree.frames().size(), 1u);
  options.max_frames = 1;
  CHECK_EQ(int{thrown([&] { zenoh_tf::Tree bad(options); })}, invalid);
}

TEST(a_caller_of_an_older_header_gets_the_fields_that_it_knows) {
  zenoh_tf::Tree tree;
  tree.set("map", "base", 1000, {1, 2, 3, 0, 0, 0, 1});
  zenoh_tf::Answer answer;
  answer.size = offsetof(ztf_answer, newest_stamp_ns);
  answer.newest_stamp_ns = answer.gap_ns = -7;
  CHECK_EQ(int{ztf_latest(tree.get(), "map", "base", &answer, nullptr)}, int{ZTF_OK});
  CHECK_EQ(answer.stamp_ns, 1000);
  CHECK_EQ(answer.newest_stamp_ns, -7);
  CHECK_EQ(answer.size, offsetof(ztf_answer, newest_stamp_ns));
  ztf_error error = new_error();
  error.size = offsetof(ztf_error, message);
  CHECK_EQ(int{ztf_latest(tree.get(), "map", "none", &answer, &error)}, int{ZTF_LOOKUP});
  CHECK_EQ(error.code, int{ZTF_LOOKUP});
  CHECK_EQ(error.message[0], '\0');
}

TEST(names_need_room) {
  zenoh_tf::Tree tree;
  tree.set("map", "base", 1000, {0, 0, 0, 0, 0, 0, 1});
  char buffer[9];
  std::size_t needed = 0;
  CHECK_EQ(int{ztf_frames(tree.get(), nullptr, 0, &needed, nullptr)}, int{ZTF_BUFFER_TOO_SMALL});
  CHECK_EQ(needed, sizeof buffer);
  CHECK_EQ(int{ztf_frames(tree.get(), buffer, needed, &needed, nullptr)}, int{ZTF_OK});
  CHECK_EQ(std::string(buffer) + "," + (buffer + std::strlen(buffer) + 1), "base,map");
}

TEST(a_reference_is_current_or_stale) {
  zenoh_tf::Tree tree, other;
  const ztf_pose pose{1, 2, 3, 0, 0, 0, 1};
  for (zenoh_tf::Tree* each : {&tree, &other}) each->set("map", "base", 1000, pose);
  ztf_frame map, base;
  CHECK_EQ(int{ztf_resolve(tree.get(), "map", &map, nullptr)}, int{ZTF_OK});
  CHECK_EQ(int{ztf_resolve(tree.get(), "base", &base, nullptr)}, int{ZTF_OK});
  zenoh_tf::Answer answer;
  const auto look_up = [&](const zenoh_tf::Tree& of) {
    return int{ztf_lookup_ref(of.get(), ZTF_AT, &map, &base, 1000, &answer, nullptr)};
  };
  CHECK_EQ(look_up(tree), int{ZTF_OK});
  CHECK_EQ(look_up(other), int{ZTF_STALE_FRAME});
  const ztf_frame none{};
  CHECK_EQ(int{ztf_lookup_ref(tree.get(), ZTF_LATEST, &none, &none, 0, &answer, nullptr)},
           int{ZTF_STALE_FRAME});
  tree.remove_frame("base");
  CHECK_EQ(look_up(tree), int{ZTF_LOOKUP});
  tree.set("map", "base", 1000, pose);
  CHECK_EQ(look_up(tree), int{ZTF_OK});  // the name has the id that it had
}

TEST(a_reference_notices_that_its_id_was_given_away) {
  zenoh_tf::Options options;
  options.max_frames = 16;
  zenoh_tf::Tree tree(options);
  const ztf_pose pose{1, 2, 3, 0, 0, 0, 1};
  tree.set("map", "base", 1000, pose);
  zenoh_tf::Pair pair = tree.pair("map", "base");
  CHECK_EQ(pair.lookup().pose.x, 1);
  ztf_frame base;
  CHECK_EQ(int{ztf_resolve(tree.get(), "base", &base, nullptr)}, int{ZTF_OK});
  tree.remove_frame("base");
  for (int i = 0; i < 64; ++i) {  // so many names need the ids of removed ones
    tree.set("map", nth("passing", i), 1000, pose);
    tree.remove_frame(nth("passing", i));
  }
  tree.set("map", "base", 2000, {7, 0, 0, 0, 0, 0, 1});
  CHECK_EQ(int{ztf_lookup_ref(tree.get(), ZTF_LATEST, &base, &base, 0, nullptr, nullptr)},
           int{ZTF_STALE_FRAME});
  CHECK_EQ(pair.lookup().pose.x, 7);  // finds the names again
  CHECK(tree.link("map", "base").append(3000, {8, 0, 0, 0, 0, 0, 1}));
  CHECK_EQ(pair.latest().pose.x, 8);
}

TEST(an_append_is_a_set_of_a_link_that_was_found) {
  zenoh_tf::Options options;
  options.cache_time_ns = 1000;
  zenoh_tf::Tree tree(options), other;
  const ztf_pose poses[] = {at(1), at(2), at(3)};
  zenoh_tf::Link link = tree.link("map", "base", "driver");
  CHECK_EQ(int{thrown([&] { link.append(1000, poses[0]); })}, int{ZTF_LOOKUP});  // not set yet
  tree.set("map", "base", 1000, poses[0]);
  CHECK(link.append(2500, poses[1]));
  CHECK_EQ(link.latest().pose.x, 2);
  CHECK_EQ(std::string(tree.info("base").authority), "driver");
  CHECK(!link.append(1, poses[0]));  // too old
  CHECK_EQ(int{thrown([&] { link.append(3000, {}); })}, int{ZTF_INVALID_ARGUMENT});

  ztf_frame map, base;
  CHECK_EQ(int{ztf_resolve(tree.get(), "map", &map, nullptr)}, int{ZTF_OK});
  CHECK_EQ(int{ztf_resolve(tree.get(), "base", &base, nullptr)}, int{ZTF_OK});
  const std::int64_t stamps[] = {3000, 1, 2800};
  std::size_t stored = 9;
  ztf_error error = new_error();
  const auto append = [&](zenoh_tf::Tree& to, const ztf_frame& parent, const ztf_frame& child) {
    return int{ztf_append(to.get(), &parent, &child, stamps, poses, 3, nullptr, &stored, &error)};
  };
  CHECK_EQ(append(tree, map, base), int{ZTF_OK});
  CHECK_EQ(stored, std::size_t{2});
  CHECK_EQ(tree.lookup("map", "base", 2900).pose.x, 2);
  CHECK_EQ(append(tree, base, base), int{ZTF_INVALID_ARGUMENT});
  CHECK_EQ(std::string(error.message),
           "cannot set the transform of child 'base' in parent 'base' (index 0): a frame cannot be "
           "its own parent");
  other.set("map", "base", 1, poses[0]);
  CHECK_EQ(append(other, map, base), int{ZTF_STALE_FRAME});
  CHECK_EQ(append(tree, map, {}), int{ZTF_STALE_FRAME});

  tree.clear();
  CHECK_EQ(append(tree, base, map), int{ZTF_OK});  // neither has a parent now
  CHECK_EQ(append(tree, map, base), int{ZTF_INVALID_ARGUMENT});
  CHECK(std::strstr(error.message, "cycle"));
  tree.set("odom", "map", 4000, poses[0]);
  CHECK_EQ(append(tree, base, map), int{ZTF_INVALID_ARGUMENT});
  CHECK_EQ(std::string(error.message),
           "cannot set the transform of child 'map' in parent 'base' (index 1): the frame has "
           "another parent now");
  CHECK_EQ(std::string(error.field) + ' ' + error.frame, "parent_frame map");
  CHECK_EQ(tree.parent("map"), "odom");
  tree.remove_frame("base");
  CHECK_EQ(append(tree, map, base), int{ZTF_STALE_FRAME});
  CHECK_EQ(tree.frames().size(), std::size_t{2});
}

TEST(an_append_to_a_full_tree_is_refused_by_its_names) {
  zenoh_tf::Options options;
  options.max_memory_bytes = 1 << 16;
  zenoh_tf::Tree tree(options);
  tree.set("map", "base", 0, at(0));
  zenoh_tf::Link link = tree.link("map", "base");
  try {
    for (Stamp stamp = 1;; ++stamp) link.append(stamp, at(1));
  } catch (const zenoh_tf::TransformException& error) {
    CHECK_EQ(int{error.code()}, int{ZTF_LIMIT});
    CHECK_EQ(std::string(error.facts().parent_frame) + ' ' + error.facts().frame, "map base");
  }
}

TEST(an_append_to_a_servers_tree_is_checked_and_then_sent) {
  const SocketFolder folder;
  Owner owner(folder, "a1");
  owner.world.set("map", "base", 1000, at_x(1));
  zenoh_tf::Tree tree = zenoh_tf::Tree::open("main", folder.path);
  zenoh_tf::Link link = tree.link("map", "base");
  const auto appended = [&] { return int{thrown([&] { link.append(2000, at(2)); })}; };
  CHECK_EQ(appended(), int{ZTF_READ_ONLY});
  owner.world.set("odom", "base", 2000, at_x(1));
  CHECK_EQ(appended(), int{ZTF_INVALID_ARGUMENT});
  owner.world.tree.remove_frame("base", false);
  CHECK_EQ(appended(), int{ZTF_LOOKUP});
}

TEST(a_lookup_waits_for_a_commit) {
  const SocketFolder folder;
  Owner owner(folder, "a1");
  zenoh_tf::Tree own;
  const zenoh_tf::Tree shared = zenoh_tf::Tree::open("main", folder.path);
  for (const zenoh_tf::Tree* tree : std::initializer_list<const zenoh_tf::Tree*>{&own, &shared}) {
    CHECK(!tree->can("map", "base", 1000, std::chrono::milliseconds(2)));
    std::thread writer([&] {
      if (tree == &own)
        own.set("map", "base", 1000, {4, 0, 0, 0, 0, 0, 1});
      else
        owner.world.set("map", "base", 1000, at_x(4));
    });
    CHECK_EQ(tree->lookup("map", "base", 1000, kLong).pose.x, 4);
    writer.join();
    try {
      (void)tree->lookup("map", "base", 2000, std::chrono::milliseconds(2));
      CHECK(!"it cannot succeed");
    } catch (const zenoh_tf::ExtrapolationException& error) {
      CHECK(std::string(error.what()).find("waited for 2 ms") != std::string::npos);
    }
  }
}

TEST(a_reader_follows_its_server) {
  const SocketFolder folder;
  CHECK_EQ(int{thrown([&] { zenoh_tf::Tree::open("main", folder.path); })},
           int{ZTF_SERVER_UNAVAILABLE});
  std::optional<Owner> owner(std::in_place, folder, "a1");
  owner->world.set("map", "base", 1000, at_x(1));
  const zenoh_tf::Tree tree = zenoh_tf::Tree::open("main", folder.path);
  CHECK_EQ(std::string(tree.server().instance), "a1");
  zenoh_tf::Pair pair = tree.pair("map", "base");
  CHECK_EQ(pair.lookup().pose.x, 1);
  ztf_frame map;
  CHECK_EQ(int{ztf_resolve(tree.get(), "map", &map, nullptr)}, int{ZTF_OK});
  owner.reset();
  CHECK_EQ(int{thrown([&] { tree.latest("map", "base"); })}, int{ZTF_SERVER_UNAVAILABLE});
  zenoh_tf::Answer answer;
  CHECK_EQ(int{pair.try_lookup(ZTF_LATEST, 0, answer)}, int{ZTF_SERVER_UNAVAILABLE});
  owner.emplace(folder, "b2");
  owner->world.set("base", "map", 1000, at_x(2));
  CHECK_EQ(tree.lookup("map", "base", kNoStamp, kLong).pose.x, -2);
  CHECK_EQ(std::string(tree.server().instance), "b2");
  CHECK_EQ(tree.server().mapped, 2u);
  CHECK_EQ(pair.lookup().pose.x, -2);
  CHECK_EQ(int{ztf_lookup_ref(tree.get(), ZTF_LATEST, &map, &map, 0, nullptr, nullptr)},
           int{ZTF_STALE_FRAME});
}

TEST(many_readers_follow_their_server) {
  const SocketFolder folder;
  std::optional<Owner> owner;
  const auto start = [&](int n) {
    owner.emplace(folder, nth("a", n));
    owner->world.set("map", "base", 1000, at_x(1));
  };
  start(0);
  const zenoh_tf::Tree tree = zenoh_tf::Tree::open("main", folder.path);
  std::atomic<bool> done{false};
  std::vector<std::thread> readers;
  for (int i = 0; i < 4; ++i)
    readers.emplace_back([&] {
      zenoh_tf::Pair pair = tree.pair("map", "base");
      zenoh_tf::Answer answer;
      while (!done) {
        const ztf_code code = pair.try_lookup(ZTF_LATEST, 0, answer);
        if (code == ZTF_OK)
          CHECK_EQ(answer.pose.x, 1);
        else if (code != ZTF_LOOKUP && code != ZTF_STALE_FRAME)  // not yet set, or mapped again
          CHECK_EQ(int{code}, int{ZTF_SERVER_UNAVAILABLE});
      }
    });
  for (int n = 1; n < 6; ++n) {
    owner.reset();
    start(n);
    CHECK_EQ(tree.lookup("map", "base", kNoStamp, kLong).pose.x, 1);
  }
  done = true;
  for (std::thread& reader : readers) reader.join();
  CHECK_EQ(tree.server().mapped, 6u);
}

TEST(a_server_of_another_tree_or_two_of_one_are_not_read) {
  const SocketFolder folder;
  const Owner one(folder, "a1"), other(folder, "b2", "main-b");
  CHECK_EQ(std::string(zenoh_tf::Tree::open("main", folder.path).server().instance), "a1");
  const zenoh_tf::Tree tree = zenoh_tf::Tree::open("main-b", folder.path);
  CHECK_EQ(std::string(tree.server().instance), "b2");
  const Owner second(folder, "c3");
  CHECK_EQ(int{thrown([&] { zenoh_tf::Tree::open("main", folder.path); })},
           int{ZTF_INVALID_ARGUMENT});
  ::chmod(folder.path.c_str(), 0777);  // anybody could put a socket there
  CHECK_EQ(int{thrown([&] { zenoh_tf::Tree::open("main-b", folder.path); })},
           int{ZTF_ACCESS_DENIED});
}

TEST(a_transaction_rests_on_what_it_has_looked_up) {
  zenoh_tf::Tree tree;
  const auto set = [&](const char* child, Stamp stamp, double x) {
    tree.set("map", child, stamp, {x, 0, 0, 0, 0, 0, 1});
  };
  int runs = 0;
  const auto copy = [&](zenoh_tf::Transaction& transaction) {
    const zenoh_tf::Answer a = transaction.latest("map", "a");
    if (runs++ == 0) set("a", 2, 7);
    transaction.set("map", "b", 2, a.pose);
  };
  set("a", 1, 5);
  tree.transact(copy);  // of what had changed before the commit
  CHECK_EQ(runs, 2);
  CHECK_EQ(tree.latest("map", "b").pose.x, 7);

  // A later lookup does not show a newer state than an earlier one.
  const auto both = [&](zenoh_tf::Transaction& transaction) {
    const double a = transaction.latest("map", "a").pose.x;
    if (runs++ == 0)
      tree.set_xact({{"map", "a", 3, c_pose(at_x(8))}, {"map", "b", 3, c_pose(at_x(8))}});
    CHECK_EQ(transaction.latest("map", "b").pose.x, a);
  };
  runs = 0;
  tree.transact(both);
  CHECK_EQ(runs, 2);

  // So is that a frame does not exist.
  const auto make = [&](zenoh_tf::Transaction& transaction) {
    const ztf_code code = thrown([&] { transaction.latest("map", "c"); });
    if (runs++ == 0) {
      CHECK_EQ(int{code}, int{ZTF_LOOKUP});
      set("c", 1, 1);
      transaction.set("map", "c", 2, c_pose(at_x(2)));
    }
  };
  runs = 0;
  tree.transact(make);
  CHECK_EQ(runs, 2);
  CHECK_EQ(tree.latest("map", "c").pose.x, 1);

  const auto fail = [&](zenoh_tf::Transaction& transaction) {
    transaction.set("map", "d", 1, c_pose(at_x(1)));
    throw 5;
  };
  int caught = 0;
  try {
    tree.transact(fail);
  } catch (int value) {
    caught = value;
  }
  CHECK_EQ(caught, 5);
  CHECK_EQ(int{thrown([&] { tree.latest("map", "d"); })}, int{ZTF_LOOKUP});
  const auto lose = [&](zenoh_tf::Transaction& transaction) {
    const Stamp newest = transaction.latest("map", "a").stamp_ns;
    set("a", newest + 1, 0);
    transaction.set("map", "a", newest + 2, c_pose(at_x(1)));
  };
  CHECK_EQ(int{thrown([&] { tree.transact(lose, "", false, 3); })}, int{ZTF_CONFLICT});
}

TEST(increments_of_many_threads_are_all_counted) {
  zenoh_tf::Tree tree;
  tree.set("map", "a", 1, c_pose(at_x(0)));
  constexpr int kThreads = 4, kRounds = 200;
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i)
    threads.emplace_back([&] {
      for (int n = 0; n < kRounds; ++n)
        tree.transact(
            [](zenoh_tf::Transaction& transaction) {
              zenoh_tf::Answer a = transaction.latest("map", "a");
              ++a.pose.x;
              transaction.set("map", "a", a.stamp_ns + 1, a.pose);
            },
            "", false, 1 << 20);
    });
  for (std::thread& thread : threads) thread.join();
  CHECK_EQ(tree.latest("map", "a").pose.x, kThreads * kRounds);
}

TEST(without_a_way_to_write_a_servers_tree_is_read_only) {
  const SocketFolder folder;
  const Owner owner(folder, "a1");
  zenoh_tf::Tree tree = zenoh_tf::Tree::open("main", folder.path);
  const auto read_only = int{ZTF_READ_ONLY};
  CHECK_EQ(int{thrown([&] { tree.set("map", "base", 1, {0, 0, 0, 0, 0, 0, 1}); })}, read_only);
  CHECK_EQ(int{thrown([&] { tree.clear(); })}, read_only);
  CHECK_EQ(int{thrown([&] { tree.remove_frame("map"); })}, read_only);
  CHECK_EQ(int{thrown([&] { zenoh_tf::Tree().server(); })}, int{ZTF_INVALID_ARGUMENT});
}

TEST(no_read_of_a_transaction_is_torn) {
  zenoh_tf::Tree tree;
  std::atomic<Stamp> clock{1};
  std::atomic<int> reading{2};
  // Both links are written together, and cancel each other.
  const auto write = [&] {
    const Stamp stamp = clock.fetch_add(1);
    const auto x = static_cast<double>(stamp);
    tree.set_xact({{"map", "base", stamp, {x, 0, 0, 0, 0, 0, 1}},
                   {"base", "tool", stamp, {-x, 0, 0, 0, 0, 0, 1}}});
  };
  write();
  std::vector<std::thread> threads;
  for (int i = 0; i < 2; ++i)
    threads.emplace_back([&] {
      while (reading > 0) write();
    });
  for (int i = 0; i < 2; ++i)
    threads.emplace_back([&] {
      ztf_frame frames[3];
      const char* const names[]{"map", "base", "tool"};
      for (int n = 0; n < 3; ++n)
        CHECK_EQ(int{ztf_resolve(tree.get(), names[n], frames + n, nullptr)}, int{ZTF_OK});
      Stamp last = 0;
      for (int changes = 0; changes < 2000;) {
        ztf_pose poses[2];
        std::int64_t stamps[2];
        CHECK_EQ(int{ztf_lookup_xact(tree.get(), ZTF_LATEST_XACT, frames, frames + 1, 2, 0, poses,
                                     stamps, nullptr)},
                 int{ZTF_OK});
        CHECK_EQ(poses[0].x, -poses[1].x);
        CHECK_EQ(stamps[0], stamps[1]);
        CHECK(stamps[0] >= last);
        changes += stamps[0] != last;
        last = stamps[0];
        const zenoh_tf::Answer answer = tree.latest_xact("map", "tool");
        CHECK_EQ(answer.pose.x, 0);
        CHECK_EQ(answer.stamp_ns, answer.newest_stamp_ns);
      }
      --reading;
    });
  for (std::thread& thread : threads) thread.join();
}
