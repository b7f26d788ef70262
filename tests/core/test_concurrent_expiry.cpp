// Commits that expire, and rows from the future. Built with yield points, so that a commit can be
// stopped after it has taken its locks.
#include <time.h>

#include <functional>

#include "fixture.hpp"

using namespace ztf;

namespace {

std::int64_t now_ns() {
  timespec time{};
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

// Commits links from "root" to each child, and returns why it was rejected, if it was.
std::optional<Rejected> commit(World& w, const std::vector<std::string>& children, Stamp stamp,
                               std::int64_t expires_ns) {
  std::vector<std::string_view> names{"root"};
  std::vector<Row> rows;
  for (const std::string& child : children) {
    rows.push_back({0, static_cast<std::uint32_t>(names.size()), stamp, at_x(1)});
    names.push_back(child);
  }
  std::vector<std::uint8_t> stored(rows.size());
  try {
    w.tree.commit({.names = names, .rows = rows, .expires_ns = expires_ns}, stored);
  } catch (Rejected& rejected) {
    return std::move(rejected);
  }
  return std::nullopt;
}

}  // namespace

TEST(an_expired_commit_writes_nothing) {
  for_each_concurrency([](Concurrency c) {
    World w(c);
    w.set("root", "a", 1);
    const Version before = w.tree.version(w.id("a"));
    for (const std::vector<std::string>& children :
         {std::vector<std::string>{"a"}, {"new"}, {"a", "new", "b"}}) {
      const auto rejected = commit(w, children, 5, now_ns());
      CHECK(rejected);
      if (!rejected) continue;
      CHECK_EQ(rejected->code, Code::timeout);
      CHECK_EQ(rejected->field, "expires_ns");
    }
    CHECK_EQ(w.tree.version(w.id("a")), before);
    CHECK_EQ(w.id("new"), 0u);
    CHECK_EQ(w.tree.info(w.id("a")).newest, 1);
    CHECK(!commit(w, {"a", "new"}, 5, now_ns() + 1'000'000'000'000));
    CHECK_EQ(w.tree.info(w.id("a")).newest, 5);
  });
}

// The commit is in time when it begins, and is stopped until it is late while it takes its locks.
TEST(a_commit_that_expires_while_it_waits_writes_nothing) {
  for_each_concurrency([](Concurrency c) {
    for (const std::vector<std::string>& children :
         {std::vector<std::string>{"a"}, {"a", "b"}, {"a", "new"}}) {
      World w(c);
      w.set("root", "a", 1);
      w.set("root", "b", 1);
      const std::int64_t expires_ns = now_ns() + 20'000'000;
      int stops = 0;
      const std::function<void()> stop = [&] {
        ++stops;
        while (now_ns() < expires_ns) continue;
      };
      yield_hook = &stop;
      const auto rejected = commit(w, children, 5, expires_ns);
      yield_hook = nullptr;
      CHECK(stops > 0);
      CHECK(rejected && rejected->code == Code::timeout);
      CHECK_EQ(w.tree.info(w.id("a")).newest, 1);
      CHECK_EQ(w.id("new"), 0u);
      CHECK(w.set("root", "a", 6));  // no lock was left
    }
  });
}

// As the commit above, for the writes that drop samples.
TEST(a_removal_that_expires_while_it_waits_drops_nothing) {
  const std::function<void(Tree&, std::int64_t)> removals[] = {
      [](Tree& tree, std::int64_t expires_ns) { tree.clear(false, expires_ns); },
      [](Tree& tree, std::int64_t expires_ns) { tree.reset(expires_ns); },
      [](Tree& tree, std::int64_t expires_ns) { tree.remove_frame("a", false, expires_ns); },
      [](Tree& tree, std::int64_t expires_ns) { tree.remove_frame("root", true, expires_ns); }};
  for_each_concurrency([&](Concurrency c) {
    for (const auto& remove : removals) {
      World w(c);
      w.set("root", "a", 1);
      const FrameId a = w.id("a");
      const Version before = w.tree.version(a);
      const std::int64_t expires_ns = now_ns() + 20'000'000;
      int stops = 0;
      const std::function<void()> stop = [&] {
        ++stops;
        while (now_ns() < expires_ns) continue;
      };
      yield_hook = &stop;
      bool is_rejected = false;
      try {
        remove(w.tree, expires_ns);
      } catch (const Rejected& rejected) {
        is_rejected = rejected.code == Code::timeout && rejected.field == "expires_ns";
      }
      yield_hook = nullptr;
      CHECK(stops > 0);
      CHECK(is_rejected);
      CHECK_EQ(w.tree.version(a), before);
      CHECK_EQ(w.tree.info(a).newest, 1);
      CHECK(w.set("root", "a", 2));  // no lock was left
      remove(w.tree, now_ns() + 1'000'000'000'000);
      CHECK_EQ(w.tree.info(a).samples, 0u);
    }
  });
}

TEST(rows_from_the_future_are_rejected_or_dropped) {
  World w;
  w.set("root", "a", 1);
  const std::string_view names[] = {"root", "a", "new", "other"};
  const Row rows[] = {
      {0, 1, 100, at_x(1)}, {0, 2, 101, at_x(1)}, {0, 1, 101, at_x(2)}, {0, 3, 9, at_x(1)}};
  std::uint8_t stored[4] = {};
  CommitRequest request{.names = names, .rows = rows, .authority = "x", .max_stamp = 100};
  try {
    w.tree.commit(request, stored);
    CHECK(false);
  } catch (const Rejected& rejected) {
    CHECK_EQ(rejected.code, Code::invalid_argument);
    CHECK_EQ(rejected.field, "stamp");
    CHECK_EQ(rejected.frame, "new");
    CHECK_EQ(rejected.value, 101);
    CHECK_EQ(rejected.limit, 100);
  }
  CHECK_EQ(w.tree.info(w.id("a")).newest, 1);
  CHECK_EQ(w.tree.authorities(), 0u);
  request.drop_old = true;
  w.tree.commit(request, stored);
  CHECK_EQ(stored[0], RowResult::stored);
  CHECK_EQ(stored[1], RowResult::from_future);
  CHECK_EQ(stored[2], RowResult::from_future);
  CHECK_EQ(stored[3], RowResult::stored);
  CHECK_EQ(w.id("new"), 0u);  // a dropped row adds no name
  CHECK_EQ(w.tree.info(w.id("a")).newest, 100);
  CHECK_EQ(w.tree.from_future(), 2u);
  CHECK_EQ(w.tree.authority_counts(1).dropped, 2u);
  // A static link holds at all times, so its stamp does not matter.
  request.is_static = true;
  w.tree.commit(request, stored);
  CHECK_EQ(stored[1], RowResult::stored);
}

TEST(a_commit_of_rows_from_the_future_alone_stores_nothing) {
  World w;
  w.set("root", "a", 1);
  const std::string_view names[] = {"root", "a"};
  const Row row{0, 1, 101, at_x(1)};
  std::uint8_t stored[1] = {};
  w.tree.commit({.names = names, .rows = {&row, 1}, .drop_old = true, .max_stamp = 100}, stored);
  CHECK_EQ(stored[0], RowResult::from_future);
  CHECK_EQ(w.tree.info(w.id("a")).newest, 1);
}
