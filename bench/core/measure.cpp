#include "measure.hpp"

#include <algorithm>
#include <barrier>
#include <chrono>
#include <exception>
#include <stdexcept>
#include <thread>

namespace bench {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// From when all threads stand ready until the last has done its calls.
double block_s(Side& side, const Case& what, unsigned threads, std::size_t calls) {
  if (threads == 1) {
    const auto start = Clock::now();
    side.run(what, calls, 0);
    return seconds_since(start);
  }
  std::barrier gate(threads + 1);
  std::exception_ptr failed;
  std::vector<std::thread> workers;
  for (unsigned t = 0; t < threads; ++t)
    workers.emplace_back([&, t] {
      gate.arrive_and_wait();
      try {
        side.run(what, calls, t);
      } catch (...) {
        failed = std::current_exception();
      }
    });
  gate.arrive_and_wait();
  const auto start = Clock::now();
  for (std::thread& worker : workers) worker.join();
  const double spent = seconds_since(start);
  if (failed) std::rethrow_exception(failed);
  return spent;
}

// Calls that fill a block; doubles as the warm-up.
std::size_t calls_for(Side& side, const Case& what, unsigned threads, double seconds) {
  std::size_t calls = 256;
  for (;;) {
    const double spent = block_s(side, what, threads, calls);
    if (spent > seconds / 4)
      return std::max<std::size_t>(
          1, static_cast<std::size_t>(static_cast<double>(calls) * seconds / spent));
    calls *= 2;
  }
}

}  // namespace

void compare(const Reply& a, const Reply& b, const std::string& what) {
  const ztf::Pose &p = a.pose, &q = b.pose;
  const double sign = p.qx * q.qx + p.qy * q.qy + p.qz * q.qz + p.qw * q.qw < 0 ? -1 : 1;
  const double off = std::max({std::abs(p.x - q.x), std::abs(p.y - q.y), std::abs(p.z - q.z),
                               std::abs(p.qx - sign * q.qx), std::abs(p.qy - sign * q.qy),
                               std::abs(p.qz - sign * q.qz), std::abs(p.qw - sign * q.qw)});
  // Not "off > 1e-9", which a NaN would pass.
  if (!(off <= 1e-9) || a.stamp != b.stamp) throw std::runtime_error("answers differ: " + what);
}

void check_answers(const Sides& sides) {
  for (const Case& what : cases()) {
    if (what.kind == Kind::set) continue;
    std::vector<std::optional<Stamp>> when{std::nullopt};
    when.insert(when.end(), times().begin(), times().begin() + 1000);
    for (const auto& time : when) {
      const Reply expected = sides.back()->ask(what.target, what.source, time);
      for (const auto& side : sides)
        compare(side->ask(what.target, what.source, time), expected,
                side->name() + ", " + what.name);
    }
  }
}

Figures measure(const Sides& sides, const Case& what, unsigned threads, const Settings& settings) {
  Figures figures{what, threads, {}};
  std::vector<std::size_t> calls;
  for (const auto& side : sides) calls.push_back(calls_for(*side, what, threads, settings.block_s));
  figures.rates.resize(sides.size());
  for (int repetition = 0; repetition < settings.repetitions; ++repetition)
    for (std::size_t i = 0; i < sides.size(); ++i)
      figures.rates[i].push_back(static_cast<double>(threads * calls[i]) /
                                 block_s(*sides[i], what, threads, calls[i]));
  return figures;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 ? values[n / 2] : (values[n / 2 - 1] + values[n / 2]) / 2;
}

}  // namespace bench
