// The threads of a concurrent test: background threads run until all foreground threads are done.
//
// Thread safety: used by the one thread that runs the test.
#pragma once

#include <atomic>
#include <functional>
#include <thread>
#include <vector>

namespace ztf {

class ThreadGroup {
 public:
  // body(stop) runs until stop is set.
  void background(std::function<void(const std::atomic<bool>&)> body) {
    backgrounds_.emplace_back([this, body = std::move(body)] { body(stop_); });
  }
  void foreground(std::function<void()> body) { foregrounds_.emplace_back(std::move(body)); }
  // The same in several threads: body(thread, stop) and body(thread), with 0, 1, ...
  void background(int threads, std::function<void(int, const std::atomic<bool>&)> body) {
    for (int i = 0; i < threads; ++i) background([i, body](const auto& stop) { body(i, stop); });
  }
  void foreground(int threads, std::function<void(int)> body) {
    for (int i = 0; i < threads; ++i) foreground([i, body] { body(i); });
  }

  // Waits for the foreground, then ends the background.
  void join() {
    for (std::thread& thread : foregrounds_) thread.join();
    stop_ = true;
    for (std::thread& thread : backgrounds_) thread.join();
    foregrounds_.clear();
    backgrounds_.clear();
  }

 private:
  std::atomic<bool> stop_{false};
  std::vector<std::thread> foregrounds_, backgrounds_;
};

}  // namespace ztf
