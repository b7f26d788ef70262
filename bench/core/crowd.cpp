#include "crowd.hpp"

#include <atomic>
#include <cmath>
#include <exception>
#include <mutex>
#include <thread>

#include "others.hpp"
#include "retries.hpp"
#include "round_trip.hpp"

namespace bench {

namespace {

using Clock = std::chrono::steady_clock;

enum class Phase { warm_up, measure, stop };

// One reads the clock twice for a timed call; calls this much longer are all timed.
constexpr double kSlowCall_s = 3e-6;
constexpr std::uint64_t kTimedEvery = 16;
constexpr std::uint64_t kDelayEvery = 512;

class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ull | 1) {}
  // Uniform in [0, end).
  std::uint32_t below(std::uint32_t end) noexcept {
    state_ ^= state_ << 13;
    state_ ^= state_ >> 7;
    state_ ^= state_ << 17;
    return static_cast<std::uint32_t>((state_ >> 32) * end >> 32);
  }

 private:
  std::uint64_t state_;
};

// One of the threads; all counts are its own until it has ended.
class Member {
 public:
  Member(Store& store, const Load& load, const PausedClock& clock, unsigned thread)
      : store_(store), load_(load), clock_(clock), thread_(thread), random_(thread + 1) {}

  void run(const std::atomic<Phase>& phase) {
    if (thread_ < load_.readers) {
      repeat(phase, turn_.read_ns, [this](std::uint64_t n) { read(n); });
      turn_.read_restarts = ztf::retries - restarts_;
    } else {
      repeat(phase, turn_.write_ns, [this](std::uint64_t) { write(); });
      turn_.write_restarts = ztf::retries - restarts_;
    }
  }
  [[nodiscard]] const Turn& turn() const { return turn_; }

 private:
  template <class Call>
  void repeat(const std::atomic<Phase>& phase, Histogram& ns, Call&& call) {
    const Clock::time_point start = Clock::now();
    std::uint64_t every = kTimedEvery;
    Phase seen = Phase::warm_up;
    for (std::uint64_t n = 0;; ++n) {
      const Phase now = phase.load(std::memory_order_relaxed);
      if (now != seen) {
        if (now == Phase::stop) return;
        const double warm_up_s = std::chrono::duration<double>(Clock::now() - start).count();
        if (warm_up_s > kSlowCall_s * static_cast<double>(n)) every = 1;
        turn_ = Turn();
        restarts_ = ztf::retries;
        seen = now;
      }
      if (n % every != 0) {
        call(n);
      } else {
        const Clock::time_point before = Clock::now();
        call(n);
        ns.add(static_cast<std::uint64_t>((Clock::now() - before).count()));
      }
      if (load_.writers != 0 && n % kDelayEvery == 0 && thread_ < load_.readers) ask_delay();
    }
  }

  void read(std::uint64_t) {
    Stamp oldest;
    const Pair pair = draw();
    const bool answered = store_.read(thread_, load_.kind, pair.target, pair.source, oldest);
    answered ? ++turn_.reads : ++turn_.unanswered;
  }

  void write() {
    const FrameIndex top = random_.below(load_.links - load_.length + 1);
    turn_.links_written += store_.write(thread_, top, load_.length, clock_.now());
    ++turn_.writes;
  }

  Pair draw() {
    if (!load_.pairs.empty())
      return load_.pairs[random_.below(static_cast<std::uint32_t>(load_.pairs.size()))];
    const FrameIndex top = random_.below(load_.links - load_.length + 1);
    return {top, top + load_.length};
  }

  // A read beside the counted ones.
  void ask_delay() {
    const Pair pair = draw();
    Stamp oldest;
    const Stamp now = clock_.now();
    if (!store_.read(thread_, load_.kind, pair.target, pair.source, oldest)) return;
    const auto now_again = static_cast<double>(clock_.now() - kStart);
    const double mean = store_.mean_newest(thread_, pair.target, load_.length);
    if (std::isnan(mean)) return;
    turn_.oldest_s += static_cast<double>(now - oldest) * 1e-9;
    turn_.mean_s += (now_again - mean) * 1e-9;
    ++turn_.delays;
  }

  Store& store_;
  const Load& load_;
  const PausedClock& clock_;
  const unsigned thread_;
  Random random_;
  std::uint64_t restarts_ = 0;  // before the turn
  alignas(128) Turn turn_;
};

void add(Turn& sum, const Turn& turn) {
  sum.reads += turn.reads;
  sum.writes += turn.writes;
  sum.links_written += turn.links_written;
  sum.unanswered += turn.unanswered;
  sum.read_restarts += turn.read_restarts;
  sum.write_restarts += turn.write_restarts;
  sum.read_ns.add(turn.read_ns);
  sum.write_ns.add(turn.write_ns);
  sum.oldest_s += turn.oldest_s;
  sum.mean_s += turn.mean_s;
  sum.delays += turn.delays;
}

}  // namespace

bool pinned(unsigned threads) { return threads <= cores().size(); }

Turn run_crowd(Store& store, const Load& load, PausedClock& clock, double warm_up_s,
               double seconds) {
  const unsigned count = load.readers + load.writers;
  const std::vector<int> own_core = pinned(count) ? cores() : std::vector<int>();
  std::atomic<Phase> phase{Phase::warm_up};
  std::exception_ptr failed;
  std::mutex failing;
  std::vector<std::unique_ptr<Member>> members;
  for (unsigned t = 0; t < count; ++t)
    members.push_back(std::make_unique<Member>(store, load, clock, t));
  clock.resume();
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < count; ++t)
    threads.emplace_back([&, t] {
      if (!own_core.empty()) pin(own_core[t]);
      try {
        members[t]->run(phase);
      } catch (...) {
        const std::lock_guard lock(failing);
        failed = std::current_exception();
      }
    });
  std::this_thread::sleep_for(std::chrono::duration<double>(warm_up_s));
  phase.store(Phase::measure);
  const Others others;
  const Clock::time_point start = Clock::now();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  phase.store(Phase::stop);
  const double spent = std::chrono::duration<double>(Clock::now() - start).count();
  const double others_cores = others.cores();
  for (std::thread& thread : threads) thread.join();
  clock.pause();
  if (failed) std::rethrow_exception(failed);
  Turn sum;
  for (const auto& member : members) add(sum, member->turn());
  sum.seconds = spent;
  sum.others_cores = others_cores;
  sum.round_trip_ns = round_trip_ns();
  return sum;
}

}  // namespace bench
