// Runs the tests of one program: all of them, or those whose names contain the first argument.
#include "check.hpp"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <thread>
#include <vector>

namespace check {

namespace {

struct Test {
  const char* name;
  Body body;
};

std::vector<Test>& tests() {
  static std::vector<Test> all;
  return all;
}

std::atomic<int> failures{0};
std::mutex output;

// Aborts the program when a test hangs. Its limit is generous, as sanitizers and busy machines are
// slow.
class Watchdog {
 public:
  explicit Watchdog(const char* name)
      : thread_([this, name] {
          std::unique_lock lock(mutex_);
          if (done_changed_.wait_for(lock, std::chrono::seconds(120), [&] { return done_; }))
            return;
          std::fprintf(stderr, "HANG in %s\n", name);
          std::abort();
        }) {}
  ~Watchdog() {
    {
      const std::lock_guard lock(mutex_);
      done_ = true;
    }
    done_changed_.notify_all();
    thread_.join();
  }

 private:
  std::mutex mutex_;
  std::condition_variable done_changed_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace

Registered::Registered(const char* name, Body body) { tests().push_back({name, body}); }

void fail(const char* file, int line, const std::string& what) {
  if (++failures > 50) return;  // failures in a loop must not hide the first one
  const std::lock_guard lock(output);
  std::fprintf(stderr, "%s:%d: %s\n", file, line, what.c_str());
}

}  // namespace check

int main(int argc, char** argv) {
  const std::string wanted = argc > 1 ? argv[1] : "";
  int run = 0;
  for (const check::Test& test : check::tests()) {
    if (std::string(test.name).find(wanted) == std::string::npos) continue;
    const int before = check::failures;
    const check::Watchdog watchdog(test.name);
    test.body();
    ++run;
    std::printf("%s %s\n", check::failures == before ? "ok  " : "FAIL", test.name);
    std::fflush(stdout);
  }
  return run == 0 || check::failures > 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
