// zenoh_tf_reader SOCKET [SERVER] makes a buffer: of this process, which it fills with the
// datagrams that it receives at the socket, or with a server's folder the server's. tf2_reader
// SOCKET is the same with tf2. Then each line of input is a command, and each answer a line of
// JSON.
#include <sched.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <iostream>
#include <new>
#include <sstream>
#include <thread>
#include <utility>
#include <vector>

#include "buffer.hpp"

namespace {

thread_local std::size_t allocations = 0;

}  // namespace

// Not inlined: GCC would take them for a mismatch of malloc() and delete.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  ++allocations;
  if (void* const memory = std::malloc(bytes)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace bench {

namespace {

using Clock = std::chrono::steady_clock;

// A control loop with many lookups a cycle: so the lookups meet as many writes as those of a loop.
constexpr auto kCycle = std::chrono::milliseconds(1);
constexpr unsigned kBurst = 200;
constexpr auto kPeriod = std::chrono::milliseconds(5);  // of asking

[[noreturn]] void fail(const char* what) {
  std::perror(what);
  std::exit(1);
}

int bind_socket(const char* path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
  const int fd = socket(AF_UNIX, SOCK_DGRAM, 0);
  if (bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) fail(path);
  return fd;
}

// As a listener: it keeps all that it receives.
void listen(int fd, Buffer& buffer) {
  Link links[16];
  for (;;) {
    const ssize_t bytes = recv(fd, links, sizeof links, 0);
    if (bytes < 0) fail("recv");
    buffer.write(links, static_cast<std::size_t>(bytes) / sizeof(Link));
  }
}

void wait_for_data(Buffer& buffer) {
  for (int i = 0; buffer.lookup(Call::names) < 0; ++i) {
    if (i == 20000) fail("no data in 20 s");
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

// Gives this thread a core, which the benchmark leaves to it, and real-time priority. Returns
// whether that is permitted.
bool isolate(int core) {
  cpu_set_t chosen;
  CPU_ZERO(&chosen);
  CPU_SET(core, &chosen);
  sched_setaffinity(0, sizeof chosen, &chosen);
  sched_param priority{};
  priority.sched_priority = 1;
  return sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
}

// Sorts in part; requires a value.
template <class T>
double percentile(std::vector<T>& values, double share) {
  const auto rank = share * static_cast<double>(values.size() - 1);
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), nth, values.end());
  return static_cast<double>(*nth);
}

// Times each of so many lookups; a reading of the clock is in each time.
void measure_latency(Buffer& buffer, Call call, unsigned lookups, int core) {
  const bool real_time = isolate(core);
  std::vector<std::uint32_t> ns(lookups);  // touched, so that no page is missing later
  unsigned failed = 0;
  const std::size_t before = allocations;
  auto next = Clock::now();
  for (unsigned i = 0; i < lookups; ++i) {
    if (i % kBurst == 0) std::this_thread::sleep_until(next += kCycle);
    const auto begin = Clock::now();
    failed += buffer.lookup(call) < 0;
    ns[i] = static_cast<std::uint32_t>((Clock::now() - begin).count());
  }
  const double allocated = static_cast<double>(allocations - before) / lookups;
  std::cout << "{\"us_p50\": " << percentile(ns, 0.5) / 1000;
  std::cout << ", \"us_p99\": " << percentile(ns, 0.99) / 1000;
  std::cout << ", \"us_p9999\": " << percentile(ns, 0.9999) / 1000;
  std::cout << ", \"us_max\": " << percentile(ns, 1) / 1000;
  std::cout << ", \"real_time\": " << real_time << ", \"allocations\": " << allocated
            << ", \"unanswered\": " << failed << '}';
}

// Looks up once in each period, and reports how old the answers were.
void ask(Buffer& buffer, Call call, double seconds) {
  std::vector<double> ages_ms;
  unsigned failed = 0;
  // Processes do not know each other: no two of them ask together.
  auto next = Clock::now() + std::chrono::microseconds(getpid() * 7919 % 5000);
  const auto end = next + std::chrono::duration<double>(seconds);
  while (next < end || ages_ms.empty()) {
    std::this_thread::sleep_until(next += kPeriod);
    const Stamp stamp = buffer.lookup(call);
    failed += stamp < 0;
    ages_ms.push_back(static_cast<double>(Clock::now().time_since_epoch().count() - stamp) * 1e-6);
  }
  std::cout << "{\"age_ms_p50\": " << percentile(ages_ms, 0.5) << ", \"unanswered\": " << failed
            << '}';
}

void print(const Answer& answer) {
  std::cout.precision(17);
  const char* separator = "[";
  for (const double value : answer.pose) std::cout << std::exchange(separator, ", ") << value;
  std::cout << ", " << answer.stamp << ']';
  std::cout.precision(6);
}

// Commands: "latency CALL LOOKUPS CORE", "ask CALL SECONDS", and "tool STAMP".
void obey(Buffer& buffer, const std::string& line) {
  std::istringstream words(line);
  std::string command;
  int call = 0, core = 0;
  double number = 0;
  words >> command;
  if (command == "tool") {
    wait_for_data(buffer);
    Stamp stamp = 0;
    words >> stamp;
    return print(buffer.tool_at(stamp));
  }
  words >> call >> number >> core;
  if (static_cast<Call>(call) != Call::nothing) wait_for_data(buffer);
  if (command == "ask") return ask(buffer, static_cast<Call>(call), number);
  measure_latency(buffer, static_cast<Call>(call), static_cast<unsigned>(number), core);
}

}  // namespace

}  // namespace bench

int main(int argc, char** argv) {
  const bool own = argc == 2;
  const auto buffer = bench::make_buffer(own ? "" : argv[2]);
  if (own) std::thread(bench::listen, bench::bind_socket(argv[1]), std::ref(*buffer)).detach();
  std::cout << "ready" << std::endl;
  for (std::string line; std::getline(std::cin, line);) {
    bench::obey(*buffer, line);
    std::cout << std::endl;
  }
  std::_Exit(0);  // the listener still uses the buffer
}
