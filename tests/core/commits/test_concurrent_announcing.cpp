// Threads that wait for a frame or a mutex announce it, so that the bindings can release the
// interpreter lock. Built with yield points, so that a commit can be stopped where it holds locks.
#include <functional>

#include "base/long_wait.hpp"
#include "fixture.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

class CountedWait final : public LongWait {
 public:
  CountedWait() { registered() = this; }
  ~CountedWait() { registered() = nullptr; }
  void begin() noexcept override {
    ++count;
    announced = true;
  }
  int count = 0;
  std::atomic<bool> announced{false};
};

// Stops a commit of `sets` while it holds its locks, runs `call` in another thread, and lets the
// commit continue only once that thread has announced that it waits.
template <class Call>
void blocked_by_commit(World& w, const std::vector<Set>& sets, Call&& call) {
  std::atomic<bool> stopped{false};
  std::atomic<CountedWait*> wait{nullptr};
  std::thread writer([&] {
    // The last yield point of a commit is its first unlock: all frames are locked then.
    const std::function<void()> stop = [&] {
      if (w.version("a") & SeqLock::kWriting) {
        stopped = true;
        while (!wait || !wait.load()->announced) std::this_thread::yield();
      }
    };
    yield_hook = &stop;
    CHECK(!w.commit(sets));
    yield_hook = nullptr;
  });
  while (!stopped) std::this_thread::yield();
  CountedWait counted;
  wait = &counted;
  call();
  CHECK_EQ(counted.count, 1);  // at most once in a call
  wait = nullptr;
  writer.join();
}

}  // namespace

TEST_EACH_MODE(a_lookup_announces_that_it_waits_for_a_commit) {
  World w(c);
  Stamp stamp = 1;
  w.set("root", "a", stamp);
  w.set("root", "b", stamp);
  for (const Op op : {Op::at, Op::latest_common, Op::latest_xact, Op::common_time, Op::full}) {
    const Stamp next = stamp + 1;
    blocked_by_commit(w, {{"root", "a", next}, {"root", "b", next}}, [&] {
      Query query = w.query(op, "root", "a", stamp);
      query.fixed = w.id("root");
      Answer answer;
      w.tree.lookup(query, answer);
      CHECK_EQ(answer.failure.code, Code::ok);
    });
    stamp = next;
  }
}

TEST_EACH_MODE(a_commit_announces_that_it_waits_for_a_commit) {
  World w(c);
  w.set("root", "a", 1);
  w.set("root", "b", 1);
  blocked_by_commit(w, {{"root", "a", 2}, {"root", "b", 2}}, [&] { CHECK(w.set("root", "a", 3)); });
  blocked_by_commit(w, {{"root", "a", 4}, {"root", "new", 4}},
                    [&] { CHECK(w.set("root", "other", 3)); });
  blocked_by_commit(w, {{"root", "a", 5}, {"root", "b", 5}},
                    [&] { CHECK_EQ(w.info("a").newest, 5); });
}

TEST_EACH_MODE(calls_that_do_not_wait_announce_nothing) {
  World w(c);
  CountedWait counted;
  for (Stamp stamp = 1; stamp < 100; ++stamp) w.set("root", "a", stamp);
  CHECK_EQ(w.code(Op::latest_common, "root", "a"), Code::ok);
  CHECK_EQ(counted.count, 0);
}
