#include "c_api/server_tree.hpp"

#include "system/host.hpp"

namespace ztf {

namespace {

constexpr std::chrono::milliseconds kPeriod{50}, kNap{1};

}  // namespace

std::uint64_t next_tree_number() noexcept {
  static std::atomic<std::uint64_t> last{0};
  return last.fetch_add(1, std::memory_order_relaxed) + 1;
}

ServerTree::ServerTree(std::string_view tree, std::string_view folder, std::int64_t timeout_ns)
    : name_(tree), folder_(folder) {
  const std::int64_t begin = monotonic_ns();
  for (;;) {
    try {
      map();
      break;
    } catch (const Rejected& rejected) {
      if (rejected.code != kServerUnavailable || monotonic_ns() - begin >= timeout_ns) throw;
    }
    (void)pause(kPeriod);
  }
  thread_ = std::thread([this] { follow(); });
}

ServerTree::~ServerTree() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

Rejected ServerTree::why_lapsed() const {
  const std::lock_guard lock(mutex_);
  if (failure_) return *failure_;
  return {.code = kServerUnavailable,
          .message = "the server of the tree " + quoted(name_) + " has stopped or ended"};
}

bool ServerTree::pause(std::chrono::nanoseconds duration) {
  std::unique_lock lock(mutex_);
  return !changed_.wait_for(lock, duration, [this] { return closing_; });
}

bool ServerTree::is_live() const noexcept { return monotonic_ns() < owned_->tree->lease_ns(); }

void ServerTree::follow() {
  while (pause(kPeriod)) {
    if (is_live()) continue;
    std::optional<Rejected> failure;
    try {
      map();
    } catch (Rejected& rejected) {
      failure = std::move(rejected);
    } catch (const std::exception& error) {  // no error may end the thread
      failure = Rejected{.code = kServerUnavailable, .message = error.what()};
    }
    code_if_lapsed_ = failure ? failure->code : kServerUnavailable;
    const std::lock_guard lock(mutex_);
    failure_ = std::move(failure);
  }
}

void ServerTree::map() {
  std::unique_ptr<const Mapped> next(
      new Mapped{map_server_tree(name_, folder_), next_tree_number()});
  if (owned_ && is_live()) return;  // the server had only stopped
  mapped_.store(next.get(), std::memory_order_seq_cst);
  times_mapped_.fetch_add(1, std::memory_order_relaxed);
  if (owned_)
    for (const Readers& readers : readers_)
      while (readers.count.load(std::memory_order_seq_cst) != 0) std::this_thread::sleep_for(kNap);
  owned_ = std::move(next);
}

}  // namespace ztf
