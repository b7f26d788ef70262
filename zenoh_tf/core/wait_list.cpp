// Parking and waking.
#include "wait_list.hpp"

#include <algorithm>
#include <limits>

#include "tree.hpp"

namespace ztf {

namespace {

constexpr Stamp kNever = std::numeric_limits<Stamp>::max();

}  // namespace

bool WaitList::lookup_or_park(Waiter& waiter) {
  // What is needed after the waiter was given away.
  const std::string_view names[] = {waiter.target_, waiter.source_, waiter.fixed_};
  for (;;) {
    Query& query = waiter.query_;
    query.target = tree_.find(waiter.target_);
    query.source = tree_.find(waiter.source_);
    query.fixed = query.op == Op::full ? tree_.find(waiter.fixed_) : 0;
    const FrameId ids[] = {query.target, query.source, query.fixed};
    ReadSet reads;
    tree_.lookup_transaction({&query, 1}, {&waiter.answer_, 1}, reads);
    const Failure& failure = waiter.answer_.failure;
    if (failure.code == Code::ok || !tree_.may_succeed_later(failure)) return true;
    {
      const std::lock_guard lock(mutex_);
      try {
        park(waiter, reads);
      } catch (...) {  // no memory
        if (waiter.parked_) unpark(waiter);
        throw;
      }
    }
    (void)tree_.commits();
    bool same = true;
    for (const ReadVersion& read : reads) same &= tree_.version(read.frame) == read.version;
    for (int i = 0; i < 3; ++i) same &= names[i].empty() || tree_.find(names[i]) == ids[i];
    if (same || !cancel(waiter)) return false;
  }
}

bool WaitList::cancel(Waiter& waiter) {
  const std::lock_guard lock(mutex_);
  if (!waiter.parked_) return false;
  unpark(waiter);
  return true;
}

void WaitList::park(Waiter& waiter, const ReadSet& reads) {
  const Query& query = waiter.query_;
  const Failure& failure = waiter.answer_.failure;
  // Where the latest common time is meant, any sample may move it.
  const bool any_time =
      query.op == Op::latest_common ||
      (query.op == Op::full && (query.stamp == kNoStamp || query.source_stamp == kNoStamp));
  const auto add = [&](FrameId frame, bool blocked, Stamp stamp) {
    Lists& lists = frames_[frame];
    Waiter::List& list = blocked ? lists.blocked : lists.passing;
    waiter.on_frames_.push_back({frame, blocked, list.emplace(stamp, &waiter)});
    tree_.mark_waited(frame, true);
  };
  SmallVector<FrameId, 64> frames;
  for (const ReadVersion& read : reads) frames.push_back(read.frame);
  std::sort(frames.begin(), frames.end());
  const FrameId* const end = std::unique(frames.begin(), frames.end());
  waiter.on_frames_.reserve(frames.size());
  waiter.on_names_.reserve(3);
  waiter.parked_ = true;
  size_.fetch_add(1, std::memory_order_seq_cst);
  for (const FrameId* frame = frames.begin(); frame != end; ++frame) {
    if (failure.stamp == kNoStamp) {  // the newest ways up do not meet
      const bool is_root = tree_.parent(*frame, kNoStamp) == 0;
      add(*frame, is_root, is_root ? kNoStamp : kNever);
    } else if (any_time) {
      add(*frame, true, kNoStamp);
    } else {
      add(*frame, tree_.parent(*frame, failure.stamp) == 0, failure.stamp);
    }
  }
  const auto miss = [&](FrameId id, std::string_view name) {
    if (id != 0 || name.empty()) return;
    for (const auto& place : waiter.on_names_)
      if (place->first == name) return;
    waiter.on_names_.push_back(names_.emplace(name, &waiter));
  };
  miss(query.target, waiter.target_);
  miss(query.source, waiter.source_);
  miss(query.fixed, waiter.fixed_);
}

void WaitList::unpark(Waiter& waiter) noexcept {
  for (const Waiter::OnFrame& on : waiter.on_frames_) {
    const auto lists = frames_.find(on.frame);
    (on.blocked ? lists->second.blocked : lists->second.passing).erase(on.place);
    if (lists->second.blocked.empty() && lists->second.passing.empty()) frames_.erase(lists);
    tree_.mark_waited(on.frame, false);
  }
  for (const auto& place : waiter.on_names_) names_.erase(place);
  waiter.on_frames_.clear();
  waiter.on_names_.clear();
  waiter.parked_ = false;
  size_.fetch_sub(1, std::memory_order_seq_cst);
}

void WaitList::wake(const std::vector<Waiter*>& waiters) noexcept {
  for (Waiter* waiter : waiters) {
    unpark(*waiter);
    waiter->notify();
  }
}

void WaitList::notify_frame(FrameId frame, Change change) {
  const std::lock_guard lock(mutex_);
  const auto at = frames_.find(frame);
  if (at == frames_.end()) return;
  const auto& [blocked, passing] = at->second;
  std::vector<Waiter*> woken;
  const auto add = [&](auto begin, auto end) {
    for (; begin != end; ++begin) woken.push_back(begin->second);
  };
  if (change == Change::other) {
    add(blocked.begin(), blocked.end());
    add(passing.begin(), passing.end());
  } else {
    // The frame now serves what lies between its oldest and its newest sample,
    // can never serve what is older than the cache, and has lost what it pruned.
    const FrameInfo info = tree_.info(frame);
    const Stamp never = std::min(tree_.oldest_possible(info.newest), info.oldest);
    add(blocked.begin(), blocked.lower_bound(never));
    add(blocked.lower_bound(info.oldest), blocked.upper_bound(info.newest));
    add(passing.begin(), passing.lower_bound(info.oldest));
  }
  wake(woken);
}

void WaitList::notify_name(std::string_view name) {
  const std::lock_guard lock(mutex_);
  std::vector<Waiter*> woken;
  const auto [begin, end] = names_.equal_range(name);
  for (auto at = begin; at != end; ++at) woken.push_back(at->second);
  wake(woken);
}

}  // namespace ztf
