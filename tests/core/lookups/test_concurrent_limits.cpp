// Limits of reads beside writers: what every state of the tree keeps is never rejected, though a
// torn walk would exceed it.
#include "fixture.hpp"
#include "records/change_log.hpp"
#include "replication/interest_reader.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

constexpr int kLinks = 60;

// Below the root are two chains and two frames. One of these frames is at the end of a chain, the
// other at the root, in turns: so both together are always that many links below the root.
class TakingTurns {
 public:
  explicit TakingTurns(Concurrency c)
      : world(Options{.cache_ns = 1'000'000, .concurrency = c, .max_log_bytes = 1 << 20}) {
    for (const std::string chain : {"a", "b"})
      for (int i = 0; i < kLinks; ++i)
        world.set(i == 0 ? "root" : nth(chain, i - 1), nth(chain, i), 1);
    for (int i = 0; i < 3; ++i) move();
  }

  void move() {
    is_left_ = !is_left_;
    stamp_ += 10'000'000;  // the samples of the other parents are pruned
    const std::string end = std::to_string(kLinks - 1);
    CHECK(!world.commit({{is_left_ ? "a" + end : "root", "x", stamp_},
                         {is_left_ ? "root" : "b" + end, "y", stamp_}}));
  }

  // Calls read() beside a thread that moves the frames, until both have run long enough.
  template <class Read>
  void beside_moves(Read&& read) {
    std::atomic<int> reads{0}, moves{0};
    ThreadGroup threads;
    threads.foreground([&] {
      for (; moves < 500 || reads < 500; ++moves) move();
    });
    threads.background([&](const std::atomic<bool>& stop) {
      for (; !stop; ++reads) read();
    });
    threads.join();
  }

  World world;

 private:
  bool is_left_ = false;
  Stamp stamp_ = 10;
};

}  // namespace

TEST_EACH_MODE(a_transaction_within_its_limit_is_never_rejected) {
  TakingTurns turns(c);
  const World& w = turns.world;
  const std::vector<Query> queries = {w.query(Op::latest_xact, "root", "x"),
                                      w.query(Op::latest_xact, "root", "y")};
  std::vector<Answer> answers(2);
  ReadSet reads;
  std::size_t most = 0;
  for (int i = 0; i < 2; ++i, turns.move()) {
    w.tree.lookup_transaction(queries, answers, reads);
    most = std::max(most, reads.size());
  }
  const auto read = [&](std::size_t limit) {
    return rejection([&] { w.tree.lookup_transaction(queries, answers, reads, limit); });
  };
  turns.beside_moves([&] { CHECK(!read(most)); });
  const auto rejected = read(most - 1);
  CHECK(rejected && rejected->code == Code::limit);
}

TEST(an_interest_within_its_limit_is_never_rejected) {
  TakingTurns turns(Concurrency::optimistic);
  InterestReader reader(turns.world.tree.state(), {{"root", "x"}, {"root", "y"}}, true);
  std::size_t most = 0;
  for (int i = 0; i < 2; ++i, turns.move()) {
    (void)reader.read(false, kLinks * 4);
    most = std::max(most, reader.frames());
  }
  const auto read = [&](std::size_t limit) {
    return rejection([&] { (void)reader.read(false, limit); });
  };
  turns.beside_moves([&] { CHECK(!read(most)); });
  const auto rejected = read(most - 1);
  CHECK(rejected && rejected->field == "interest_frames");
}
