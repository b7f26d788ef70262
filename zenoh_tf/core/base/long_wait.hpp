// What a thread does before it waits for long inside the core: the bindings release the interpreter
// lock then, so that nobody waits behind a thread that waits for a frame.
//
// A call of the core that waits only now and then keeps the interpreter lock, because releasing it
// costs more than a lookup. It registers a LongWait instead. The lock must not be taken back before
// the call returns, because the thread may hold locks of the core.
//
// Thread safety: each thread has a registration of its own.
#pragma once

#include <mutex>
#include <utility>

namespace ztf {

class LongWait {
 public:
  // Called once, before the registering thread's first long wait. Must not block.
  virtual void begin() noexcept = 0;

  // This thread's registration, or null.
  static LongWait*& registered() noexcept {
    static thread_local constinit LongWait* registration = nullptr;
    return registration;
  }
  // To be called before a wait that may be long, or work that is long.
  static void announce() noexcept {
    if (LongWait* const registration = std::exchange(registered(), nullptr)) registration->begin();
  }

 protected:
  ~LongWait() = default;
};

// Locks the mutex, and announces the wait if another thread has it.
inline std::unique_lock<std::mutex> lock_announced(std::mutex& mutex) {
  std::unique_lock lock(mutex, std::try_to_lock);
  if (!lock) {
    LongWait::announce();
    lock.lock();
  }
  return lock;
}

}  // namespace ztf
