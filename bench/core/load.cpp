#include "load.hpp"

#include <sched.h>

#include <algorithm>
#include <numeric>
#include <thread>

#include "base/retries.hpp"

namespace bench {

namespace {

// One call of each block is timed. Blocks of this length make the clock readings negligible.
constexpr auto kBlock = std::chrono::microseconds(4);
constexpr unsigned kMaxBlock = 256;
constexpr double kReadsPerDelay = 512;

// Pins the calling thread to the nth core that the process may use, if there are `count`.
void pin(unsigned nth, unsigned count) {
  cpu_set_t usable, chosen;
  if (sched_getaffinity(0, sizeof usable, &usable) != 0) return;
  if (static_cast<unsigned>(CPU_COUNT(&usable)) < count) return;
  int core = -1;
  for (unsigned seen = 0; seen <= nth; ++core) seen += CPU_ISSET(core + 1, &usable) != 0;
  CPU_ZERO(&chosen);
  CPU_SET(core, &chosen);
  sched_setaffinity(0, sizeof chosen, &chosen);
}

Clock::duration to_duration(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

double age_s(Stamp now, Stamp stamp) { return static_cast<double>(now - stamp) * 1e-9; }

// Sorts in part; requires a value.
template <class T>
double percentile(std::vector<T>& values, double share) {
  const auto rank = share * static_cast<double>(values.size() - 1);
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), nth, values.end());
  return static_cast<double>(*nth);
}

// What the calls of a role did. Done are reads that found a transform, or links written.
enum { kCalls, kDone, kRetries, kDelays, kOldest_s, kMean_s, kCounts };
struct Counts {
  std::array<double, kCounts> sums{};
  std::vector<std::uint32_t> ns;  // of the timed calls
};

class Worker {
 public:
  Worker(Instance& instance, const Trial& trial, unsigned thread)
      : instance_(instance), trial_(trial), thread_(thread), random_(thread + 1) {
    for (Request& request : requests_) request = trial.draw(random_);
  }

  [[nodiscard]] bool reads() const { return thread_ < trial_.readers; }
  [[nodiscard]] const Counts& counts() const { return counts_; }

  // Calls until `end`, and counts from `start` on.
  void run(Clock::time_point start, Clock::time_point end) {
    pin(thread_, trial_.readers + trial_.writers);
    const bool varies = trial_.draw.frames > trial_.draw.length + 1 || trial_.read == Read::at;
    unsigned block = 1;
    std::uint64_t retries_before = 0;
    bool counted = false;
    for (Clock::time_point now; (now = Clock::now()) < end;) {
      if (!counted && now >= start) {
        counted = true;
        counts_ = Counts();
        retries_before = ztf::retries;
      }
      if (reads() && varies)
        for (unsigned i = 0; i < block; ++i) requests_[i] = trial_.draw(random_);
      const Clock::time_point first = Clock::now();
      call(0, block - 1);
      const Clock::time_point last = Clock::now();
      call(block - 1, block);
      const Clock::time_point done = Clock::now();
      counts_.ns.push_back(static_cast<std::uint32_t>((done - last).count()));
      if (!counted && done - first < kBlock && block < kMaxBlock) block *= 2;
      if (reads() && trial_.writers > 0 &&
          counts_.sums[kCalls] > kReadsPerDelay * counts_.sums[kDelays])
        measure_delay();
    }
    if (!counted) counts_ = Counts();  // a thread that had no processor in time
    counts_.sums[kRetries] = static_cast<double>(ztf::retries - retries_before);
  }

 private:
  void call(unsigned begin, unsigned end) {
    counts_.sums[kCalls] += end - begin;
    Reply last;
    if (reads())
      counts_.sums[kDone] +=
          instance_.system->lookup(trial_.read, &requests_[begin], end - begin, last);
    for (; !reads() && begin < end; ++begin) counts_.sums[kDone] += write();
  }

  unsigned write() {
    if (trial_.own_links) {  // own links of two threads are no neighbours
      Stamp& stamp = instance_.next_stamp[thread_];
      return instance_.system->write(2 * thread_ + 1, 1, stamp += trial_.period);
    }
    const FrameIndex top = random_.below(trial_.draw.frames - trial_.draw.length);
    return instance_.system->write(top + 1, trial_.draw.length, instance_.now());
  }

  // Makes a read beside the counted ones: time of the call less the stamps of the data used.
  void measure_delay() {
    const Request row = trial_.draw(random_);
    Reply reply;
    const Stamp now = instance_.now();
    if (!instance_.system->lookup(trial_.read, &row, 1, reply)) return;
    ++counts_.sums[kDelays];
    counts_.sums[kOldest_s] += age_s(now, reply.stamp);
    for (FrameIndex frame = row.target; frame < row.source; ++frame) {
      const Request link{frame, frame + 1};
      const Stamp asked = instance_.now();
      if (instance_.system->lookup(Read::latest_common, &link, 1, reply))
        counts_.sums[kMean_s] += age_s(asked, reply.stamp) / trial_.draw.length;
    }
  }

  Instance& instance_;
  const Trial& trial_;
  const unsigned thread_;
  Random random_;
  Request requests_[kMaxBlock];
  alignas(128) Counts counts_;
};

// Adds the figures of readers or of writers to those of the trial.
void summarize(Metrics& metrics, bool reads, Counts& counts, double seconds, bool transactions) {
  if (counts.ns.empty()) return;
  const auto& sums = counts.sums;
  const std::string role = reads ? "read" : "write";
  metrics[reads ? "reads_per_s" : "links_written_per_s"] = sums[kDone] / seconds;
  // The report counts each of tf2's sets as an operation, and a transaction of many as one.
  metrics["operations_per_s"] += sums[reads || !transactions ? kDone : kCalls] / seconds;
  metrics["retries_per_" + role] = sums[kRetries] / sums[kCalls];
  metrics[role + "_us_p50"] = percentile(counts.ns, 0.5) / 1000;
  if (reads) {
    metrics["read_us_p99"] = percentile(counts.ns, 0.99) / 1000;
    metrics["read_us_p999"] = percentile(counts.ns, 0.999) / 1000;
    metrics["unanswered_share"] = 1 - sums[kDone] / sums[kCalls];
  }
  if (sums[kDelays] == 0) return;
  metrics["delay_oldest_s"] = sums[kOldest_s] / sums[kDelays];
  metrics["delay_mean_s"] = sums[kMean_s] / sums[kDelays];
}

}  // namespace

Metrics run_trial(Instance& instance, const Trial& trial) {
  std::vector<std::unique_ptr<Worker>> workers;
  for (unsigned t = 0; t < trial.readers + trial.writers; ++t)
    workers.push_back(std::make_unique<Worker>(instance, trial, t));
  instance.resume();
  const auto start = Clock::now() + to_duration(std::min(1.0, trial.seconds / 4));
  const auto end = start + to_duration(trial.seconds);
  std::vector<std::thread> threads;
  for (auto& worker : workers) threads.emplace_back([&] { worker->run(start, end); });
  for (std::thread& thread : threads) thread.join();
  instance.pause();
  Metrics metrics;
  for (const bool reads : {true, false}) {
    Counts all;
    for (const auto& worker : workers) {
      if (worker->reads() != reads) continue;
      const auto& [sums, ns] = worker->counts();
      for (int i = 0; i < kCounts; ++i) all.sums[i] += sums[i];
      all.ns.insert(all.ns.end(), ns.begin(), ns.end());
    }
    summarize(metrics, reads, all, trial.seconds, instance.system->has_transactions());
  }
  return metrics;
}

Metrics measure_staleness(Instance& instance, Read read, const std::vector<double>& rates_hz,
                          double seconds) {
  const auto links = static_cast<FrameIndex>(rates_hz.size());
  std::vector<std::thread> publishers;
  instance.resume();
  const auto begin = Clock::now() + std::chrono::milliseconds(300);  // when all have published
  const auto end = begin + to_duration(seconds);
  for (FrameIndex link = 1; link <= links; ++link)
    publishers.emplace_back([&, link, period = to_duration(1 / rates_hz[link - 1])] {
      // Publishers know nothing of each other: no two start together.
      for (auto next = Clock::now() + period * link / (links + 1); next < end; next += period) {
        std::this_thread::sleep_until(next);
        instance.system->write(link, 1, instance.now());
      }
    });
  std::this_thread::sleep_until(begin);
  std::vector<std::vector<double>> ages_ms(links);
  for (unsigned n = 0; Clock::now() < end; ++n) {
    std::this_thread::sleep_for(std::chrono::microseconds(500 + n * 7919 % 1000));  // no fixed rate
    const Request row{0, links};
    const Stamp now = instance.now();
    Reply reply;
    if (!instance.system->lookup(read, &row, 1, reply)) continue;
    for (FrameIndex i = 0; i < links; ++i) {
      // A lookup at a common time uses every link as it was then.
      const Request link{i, i + 1};
      if (read != Read::latest_common) instance.system->lookup(read, &link, 1, reply);
      ages_ms[i].push_back(1000 * age_s(now, reply.stamp));
    }
  }
  for (std::thread& publisher : publishers) publisher.join();
  instance.pause();
  Metrics metrics;
  for (FrameIndex i = 0; i < links; ++i) {
    std::vector<double>& ages = ages_ms[i];
    if (ages.empty()) continue;
    const std::string link = "link" + std::to_string(i);
    metrics[link + "_ms_mean"] =
        std::reduce(ages.begin(), ages.end()) / static_cast<double>(ages.size());
    metrics[link + "_ms_p99"] = percentile(ages, 0.99);
  }
  return metrics;
}

}  // namespace bench
