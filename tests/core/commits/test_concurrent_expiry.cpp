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

// Links from "root" to each child.
std::vector<Set> links(const std::vector<std::string>& children, Stamp stamp) {
  std::vector<Set> sets;
  for (const std::string& child : children) sets.push_back({"root", child, stamp, at_x(1)});
  return sets;
}

// Calls write(expires_ns), which is in time when it begins, and is stopped until it is late at its
// first yield point: checks that it is rejected.
template <class Write>
void stopped_until_late(Write&& write) {
  const std::int64_t expires_ns = now_ns() + 20'000'000;
  int stops = 0;
  const std::function<void()> stop = [&] {
    ++stops;
    while (now_ns() < expires_ns) continue;
  };
  yield_hook = &stop;
  const auto rejected = rejection([&] { write(expires_ns); });
  yield_hook = nullptr;
  CHECK(stops > 0);
  CHECK(rejected && rejected->code == Code::timeout && rejected->field == "expires_ns");
}

constexpr std::int64_t kLong = 1'000'000'000'000;

}  // namespace

TEST_EACH_MODE(an_expired_commit_writes_nothing) {
  World w(c);
  w.set("root", "a", 1);
  const Version before = w.version("a");
  for (const std::vector<std::string>& children :
       {std::vector<std::string>{"a"}, {"new"}, {"a", "new", "b"}}) {
    const auto rejected = w.commit(links(children, 5), {.expires_ns = now_ns()});
    CHECK(rejected && rejected->code == Code::timeout && rejected->field == "expires_ns");
  }
  CHECK_EQ(w.version("a"), before);
  CHECK_EQ(w.id("new"), 0u);
  CHECK_EQ(w.info("a").newest, 1);
  w.accept(links({"a", "new"}, 5), {.expires_ns = now_ns() + kLong});
  CHECK_EQ(w.info("a").newest, 5);
}

// The commit is in time when it begins, and is stopped until it is late while it takes its locks.
TEST_EACH_MODE(a_commit_that_expires_while_it_waits_writes_nothing) {
  for (const std::vector<std::string>& children :
       {std::vector<std::string>{"a"}, {"a", "b"}, {"a", "new"}}) {
    World w(c);
    w.set("root", "a", 1);
    w.set("root", "b", 1);
    stopped_until_late([&](std::int64_t expires_ns) {
      if (auto rejected = w.commit(links(children, 5), {.expires_ns = expires_ns}))
        throw std::move(*rejected);
    });
    CHECK_EQ(w.info("a").newest, 1);
    CHECK_EQ(w.id("new"), 0u);
    CHECK(w.set("root", "a", 6));  // no lock was left
  }
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
      stopped_until_late([&](std::int64_t expires_ns) { remove(w.tree, expires_ns); });
      CHECK_EQ(w.tree.version(a), before);
      CHECK_EQ(w.tree.info(a).newest, 1);
      CHECK(w.set("root", "a", 2));  // no lock was left
      remove(w.tree, now_ns() + kLong);
      CHECK_EQ(w.tree.info(a).samples, 0u);
    }
  });
}

TEST(rows_from_the_future_are_rejected_or_dropped) {
  World w;
  w.set("root", "a", 1);
  const std::vector<Set> sets = {{"root", "a", 100, at_x(1)},
                                 {"root", "new", 101, at_x(1)},
                                 {"root", "a", 101, at_x(2)},
                                 {"root", "other", 9, at_x(1)}};
  SetOptions options{.authority = "x", .max_stamp = 100};
  const auto rejected = w.commit(sets, options);
  CHECK(rejected && rejected->code == Code::invalid_argument && rejected->field == "stamp" &&
        rejected->frame == "new" && rejected->value == 101 && rejected->limit == 100);
  CHECK_EQ(w.info("a").newest, 1);
  CHECK_EQ(w.tree.authorities(), 0u);
  options.drop_old = true;
  std::vector<std::uint8_t> stored;
  CHECK(!w.commit(sets, options, &stored));
  CHECK(stored == std::vector({RowResult::stored, RowResult::from_future, RowResult::from_future,
                               RowResult::stored}));
  CHECK_EQ(w.id("new"), 0u);  // a dropped row adds no name
  CHECK_EQ(w.info("a").newest, 100);
  CHECK_EQ(w.tree.from_future(), 2u);
  CHECK_EQ(w.tree.authority_counts(1).dropped, 0u);  // counted once, as from the future
  // A commit of such rows alone stores nothing.
  CHECK(!w.commit({{"root", "a", 101, at_x(1)}}, options, &stored));
  CHECK_EQ(stored[0], RowResult::from_future);
  CHECK_EQ(w.info("a").newest, 100);
  // A static link holds at all times, so its stamp does not matter.
  options.is_static = true;
  CHECK(!w.commit(sets, options, &stored));
  CHECK_EQ(stored[1], RowResult::stored);
}
