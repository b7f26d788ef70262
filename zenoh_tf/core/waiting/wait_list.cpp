// Parking and waking.
#include "waiting/wait_list.hpp"

#include <algorithm>
#include <limits>

#include "base/rejected.hpp"
#include "reads/frame_reads.hpp"

namespace ztf {

namespace {

// A time that no sample has: only a change of the link itself wakes the waiter.
constexpr Stamp kNever = std::numeric_limits<Stamp>::max();

}  // namespace

class WaitList::WokenList {
 public:
  void add(Waiter* waiter) noexcept {
    if (waiter->is_woken_) return;  // parked twice under this frame
    waiter->is_woken_ = true;
    waiter->next_woken_ = nullptr;
    *end_ = waiter;
    end_ = &waiter->next_woken_;
  }
  template <class Iterator>
  void add(Iterator begin, Iterator end) noexcept {
    for (; begin != end; ++begin) add(begin->second);
  }
  // Calls visit(waiter) for each. The waiter may be destroyed when visit() returns.
  template <class Visit>
  void for_each(Visit&& visit) const noexcept {
    for (Waiter* waiter = first_; waiter != nullptr;) {
      Waiter* const next = waiter->next_woken_;
      visit(*waiter);
      waiter = next;
    }
  }

 private:
  Waiter* first_ = nullptr;
  Waiter** end_ = &first_;
};

void WaitList::park(Waiter& waiter, std::span<const Part> parts, std::size_t max_links) {
  const auto lock = lock_announced(mutex_);
  try {
    park_on_all(waiter, parts, max_links);
  } catch (...) {
    if (waiter.parked_) unpark(waiter);
    throw;
  }
}

bool WaitList::cancel(Waiter& waiter) {
  const auto lock = lock_announced(mutex_);
  if (!waiter.parked_) return false;
  unpark(waiter);
  return true;
}

void WaitList::park_on_all(Waiter& waiter, std::span<const Part> parts, std::size_t max_links) {
  std::vector<std::vector<FrameId>> frames(parts.size());
  std::size_t links = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (const ReadVersion& read : parts[i].reads) frames[i].push_back(read.frame);
    std::sort(frames[i].begin(), frames[i].end());
    frames[i].erase(std::unique(frames[i].begin(), frames[i].end()), frames[i].end());
    links += frames[i].size();
  }
  if (links > max_links || links_ > max_links - links)
    throw Rejected{.code = Code::limit, .message = "waiting lookups watch too many frames"};
  waiter.on_frames_.reserve(links);
  waiter.on_names_.reserve(3);
  waiter.parked_ = true;
  size_.fetch_add(1, std::memory_order_seq_cst);
  for (std::size_t i = 0; i < parts.size(); ++i)
    for (const FrameId frame : frames[i]) park_on_frame(waiter, frame, parts[i]);
  const Query& query = waiter.query_;
  park_on_name(waiter, query.target, waiter.target_);
  park_on_name(waiter, query.source, waiter.source_);
  park_on_name(waiter, query.fixed, waiter.fixed_);
}

void WaitList::park_on_frame(Waiter& waiter, FrameId frame, const Part& part) {
  using Role = Waiter::Role;
  Role role = Role::lacks_sample;
  Stamp stamp = kNoStamp;
  if (part.time == kNoStamp) {
    if (read_parent(records_, frame, kNoStamp) != 0) role = Role::on_path, stamp = kNever;
  } else if (!part.any_sample) {
    role = read_parent(records_, frame, part.time) == 0 ? Role::lacks_sample : Role::on_path;
    stamp = part.time;
  }
  const auto at = frames_.try_emplace(frame).first;
  try {
    waiter.on_frames_.push_back({frame, role, at->second.of(role).emplace(stamp, &waiter)});
  } catch (...) {
    erase_if_empty(at);
    throw;
  }
  ++links_;
  waiters_[frame].fetch_add(1, std::memory_order_seq_cst);
}

// Parks the waiter under a name that it misses. Does nothing if the frame exists or the name is
// empty.
void WaitList::park_on_name(Waiter& waiter, FrameId id, std::string_view name) {
  if (id != 0 || name.empty()) return;
  for (const auto& entry : waiter.on_names_)
    if (entry->first == name) return;
  waiter.on_names_.push_back(names_.emplace(name, &waiter));
}

void WaitList::unpark(Waiter& waiter) noexcept {
  for (const Waiter::ParkedOnFrame& parked : waiter.on_frames_) {
    const auto waiters = frames_.find(parked.frame);
    waiters->second.of(parked.role).erase(parked.entry);
    erase_if_empty(waiters);
    waiters_[parked.frame].fetch_sub(1, std::memory_order_seq_cst);
  }
  for (const auto& entry : waiter.on_names_) names_.erase(entry);
  links_ -= waiter.on_frames_.size();
  waiter.on_frames_.clear();
  waiter.on_names_.clear();
  waiter.parked_ = waiter.is_woken_ = false;
  size_.fetch_sub(1, std::memory_order_seq_cst);
}

void WaitList::erase_if_empty(Frames::iterator frame) noexcept {
  if (frame->second.lacking_sample.empty() && frame->second.passing.empty()) frames_.erase(frame);
}

void WaitList::wake(const WokenList& woken) noexcept {
  woken.for_each([&](Waiter& waiter) {
    unpark(waiter);
    waiter.notify();
  });
}

void WaitList::notify_frame(FrameId frame, Change change) noexcept {
  const auto lock = lock_announced(mutex_);
  const auto at = frames_.find(frame);
  if (at == frames_.end()) return;
  const auto& [lacking_sample, passing] = at->second;
  WokenList woken;
  if (change == Change::other) {
    woken.add(lacking_sample.begin(), lacking_sample.end());
    woken.add(passing.begin(), passing.end());
  } else {
    // The frame now serves the times from its oldest to its newest sample. Lookups at times that it
    // does not accept any more are woken to fail for good.
    const FrameInfo info = read_info(records_[frame], events_[frame]);
    const Stamp oldest_possible = std::min(oldest_insertable(info, options_), info.oldest);
    woken.add(lacking_sample.begin(), lacking_sample.lower_bound(oldest_possible));
    woken.add(lacking_sample.lower_bound(info.oldest), lacking_sample.upper_bound(info.newest));
    woken.add(passing.begin(), passing.lower_bound(info.oldest));
  }
  wake(woken);
}

void WaitList::notify_name(std::string_view name) noexcept {
  const auto lock = lock_announced(mutex_);
  const auto [begin, end] = names_.equal_range(name);
  WokenList woken;
  woken.add(begin, end);
  wake(woken);
}

}  // namespace ztf
