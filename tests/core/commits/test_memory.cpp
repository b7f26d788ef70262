// Commits and lookups for which there is no memory. Each allocation fails in its turn; nothing is
// left locked, half done or lost.
#include <cstdlib>
#include <new>

#include "fixture.hpp"

namespace {

thread_local long allocations_left = -1;  // before one fails; below 0: none does

[[maybe_unused]] void* allocate(std::size_t bytes, std::size_t alignment) {
  if (allocations_left == 0) throw std::bad_alloc();
  if (allocations_left > 0) --allocations_left;
  void* memory =
      alignment > alignof(std::max_align_t)
          ? std::aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment)
          : std::malloc(bytes);
  if (!memory) throw std::bad_alloc();
  return memory;
}

}  // namespace

// Clang's thread sanitizer defines these operators itself and does not link with others. Then no
// allocation fails, and the tests have nothing to do.
#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define ZTF_CANNOT_REPLACE_NEW
#endif
#endif

#ifndef ZTF_CANNOT_REPLACE_NEW
constexpr bool kCanFail = true;
// All of them are replaced, so that none is mixed with a sanitizer's. Out of line: else the
// compiler sees free() of what new returned, and warns.
[[gnu::noinline]] void* operator new(std::size_t n) { return allocate(n, 1); }
[[gnu::noinline]] void* operator new[](std::size_t n) { return allocate(n, 1); }
[[gnu::noinline]] void* operator new(std::size_t n, std::align_val_t a) {
  return allocate(n, static_cast<std::size_t>(a));
}
[[gnu::noinline]] void* operator new[](std::size_t n, std::align_val_t a) {
  return allocate(n, static_cast<std::size_t>(a));
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete[](void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete[](void* p, std::size_t) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete[](void* p, std::align_val_t) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  std::free(p);
}
[[gnu::noinline]] void operator delete[](void* p, std::size_t, std::align_val_t) noexcept {
  std::free(p);
}
#else
constexpr bool kCanFail = false;
#endif

using namespace ztf;

namespace {

// Runs body again and again, each time with one more allocation that succeeds, until it succeeds
// itself. Returns how often it failed.
template <class Body, class AfterFailure>
long fail_each_allocation(Body&& body, AfterFailure&& after_failure) {
  for (long n = 0;; ++n) {
    allocations_left = n;
    try {
      body();
      allocations_left = -1;
      return n;
    } catch (const std::bad_alloc&) {
      allocations_left = -1;
      after_failure();
    }
  }
}

// A commit whose request is built beforehand, so that nothing but the core allocates.
struct Prepared {
  std::vector<std::string> names;
  std::vector<std::string_view> views;
  std::vector<Row> rows;
  std::vector<std::uint8_t> stored;

  Prepared(const std::string& prefix, std::uint32_t links, Stamp stamp) : stored(links) {
    for (std::uint32_t i = 0; i <= links; ++i)
      names.push_back(i ? prefix + std::string(200, 'x') + std::to_string(i) : "root");
    for (const std::string& name : names) views.push_back(name);
    for (std::uint32_t i = links; i-- > 0;) rows.push_back({i, i + 1, stamp, at_x(1)});
  }
};

}  // namespace

// A write either fails and changes nothing, or it is done and wakes every waiter: no allocation
// fails between the two.
TEST_EACH_MODE(a_write_that_is_done_wakes_its_waiters_without_memory) {
  World w(c);
  w.set("root", "a", 1);
  CountingWaiter for_sample(w, Op::at, "root", "a", 9), for_newest(w, Op::at, "root", "a", 50),
      for_name(w, Op::at, "root", "new", 1);
  const auto check = [&](auto&& write) {
    const std::string before = w.state();
    const int woken = for_sample.woken + for_newest.woken + for_name.woken;
    fail_each_allocation(write, [&] {
      CHECK_EQ(w.state(), before);
      CHECK_EQ(for_sample.woken + for_newest.woken + for_name.woken, woken);
    });
  };
  const auto commit = [&](std::string_view child, Stamp stamp) {
    const std::string_view names[] = {"root", child};
    const Row row{0, 1, stamp, at_x(1)};
    std::uint8_t stored[1];
    check([&] { w.tree.commit({names, {&row, 1}}, stored); });
  };
  for (CountingWaiter* waiter : {&for_sample, &for_newest, &for_name})
    CHECK(!waiter->lookup_or_park());
  commit("a", 9);  // appends a sample
  CHECK_EQ(for_sample.woken, 1);
  CHECK_EQ(for_newest.woken, 0);
  commit("new", 1);  // adds a name
  CHECK_EQ(for_name.woken, 1);
  check([&] { w.tree.clear(true); });
  CHECK_EQ(for_newest.woken, 1);
  w.set("root", "a", 1);
  CHECK(!for_sample.lookup_or_park());
  CHECK(!for_newest.lookup_or_park());
  check([&] { w.tree.remove_frame("a", false); });
  CHECK_EQ(for_sample.woken, 2);
  CHECK_EQ(for_newest.woken, 2);
  CHECK_EQ(w.tree.wait_list().size(), 0u);
}

TEST_EACH_MODE(a_commit_without_memory_is_no_commit) {
  World w(c);
  w.set("root", "other", 1);
  for (Stamp stamp = 1; stamp <= 9; ++stamp) {  // names, then samples, then bigger rings
    Prepared p("f", 100, stamp);
    const std::string before = w.state();
    const long failures = fail_each_allocation([&] { w.tree.commit({p.views, p.rows}, p.stored); },
                                               [&] { CHECK_EQ(w.state(), before); });
    CHECK(!kCanFail || failures > 3);
    Answer a;
    w.tree.lookup({Op::latest_xact, w.id("root"), w.id(p.names.back())}, a);
    CHECK_EQ(a.failure.code, Code::ok);
    CHECK_EQ(a.pose.x, 100);
    CHECK_EQ(a.stamp, stamp);
  }
}

TEST_EACH_MODE(clearing_without_memory_clears_nothing) {
  World w(c);
  Prepared p("f", 100, 1);
  w.tree.commit({p.views, p.rows}, p.stored);
  const std::string before = w.state();
  const long failures =
      fail_each_allocation([&] { w.tree.clear(true); }, [&] { CHECK_EQ(w.state(), before); });
  CHECK(!kCanFail || failures > 2);
  CHECK_EQ(w.tree.info(2).samples, 0u);
}

TEST_EACH_MODE(a_lookup_without_memory_leaves_no_lock) {
  World w(c);
  Prepared p("f", 300, 1);
  w.tree.commit({p.views, p.rows}, p.stored);
  const Query q{Op::latest_xact, w.id("root"), w.id(p.names.back())};
  Answer a;
  const long failures = fail_each_allocation([&] { w.tree.lookup(q, a); }, [] {});
  CHECK(!kCanFail || failures > 2);
  CHECK_EQ(a.pose.x, 300);
  ReadSet reads;
  fail_each_allocation([&] { w.tree.lookup_transaction({&q, 1}, {&a, 1}, reads); }, [] {});
  Prepared again("f", 300, 2);
  w.tree.commit({again.views, again.rows}, again.stored);  // hangs if a shared lock was left
  CHECK_EQ(w.ask(Op::latest_xact, "root", p.names.back()).stamp, 2);
}
