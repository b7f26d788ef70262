// How much of the machine others use while something is measured: on a shared one, a turn that they
// disturbed can be told from one that was slow by itself.
//
// Thread safety: none.
#pragma once

#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <string>

namespace bench {

class Others {
 public:
  // Cores in use since this was made by anyone but this process, the hypervisor included; NaN where
  // the system does not tell.
  [[nodiscard]] double cores() const {
    const double seconds = std::chrono::duration<double>(Clock::now() - start_).count();
    return ((all() - all_) - (own() - own_)) / seconds;
  }

 private:
  using Clock = std::chrono::steady_clock;

  // Processor time in seconds.
  static double all() {
    std::ifstream stat("/proc/stat");
    std::string cpu;
    double user, nice, system, idle, waiting, interrupts, soft_interrupts, steal;
    if (!(stat >> cpu >> user >> nice >> system >> idle >> waiting >> interrupts >>
          soft_interrupts >> steal))
      return std::nan("");
    return (user + nice + system + interrupts + soft_interrupts + steal) /
           static_cast<double>(sysconf(_SC_CLK_TCK));
  }
  static double own() {
    rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    const auto seconds = [](const timeval& time) {
      return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
    };
    return seconds(usage.ru_utime) + seconds(usage.ru_stime);
  }

  const Clock::time_point start_ = Clock::now();
  const double all_ = all(), own_ = own();
};

}  // namespace bench
