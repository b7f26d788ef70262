// How a commit decides that time has jumped (docs/explanation/clocks.md): samples whose stamps are
// far from their frame's are dropped, or are strays, until enough of them follow one another.
//
// The samples that were far from a frame's are a run (FrameEvents::run_*). Every sample that is
// stored changes the frame's version, which ends the run.
#include <algorithm>

#include "commits/plan.hpp"
#include "system/host.hpp"

namespace ztf {

namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
// Stamps further apart are of two clocks: a simulation, a recording, and the real time.
constexpr std::uint64_t kOtherClockNs = 86'400'000'000'000;
// Samples of another clock are a time jump once there are so many, or they span so much time.
constexpr std::uint32_t kRunRows = 10;
constexpr std::uint64_t kRunNs = 5'000'000'000;

// After a jump ahead, stamps so near to those before it are the return of the clock before.
constexpr std::uint64_t kReturnNs = 3'600'000'000'000;

std::uint64_t distance_ns(Stamp a, Stamp b) noexcept {
  return a < b ? span_ns(a, b) : span_ns(b, a);
}

// Whether a stamp is later than the real-time clock by more than this.
bool is_ahead(Stamp stamp, Stamp now, std::uint64_t most_ns) noexcept {
  return stamp > now && span_ns(now, stamp) > most_ns;
}

// Whether a stamp may be of the real-time clock, and up to a day old.
bool is_of_clock(Stamp stamp, Stamp now, std::uint64_t cache_ns) noexcept {
  return stamp > now ? span_ns(now, stamp) <= cache_ns : span_ns(stamp, now) <= kOtherClockNs;
}

bool continues_long(const FrameEvents& events) noexcept {
  const std::uint64_t span =
      span_ns(events.run_first.load(kRelaxed), events.run_last.load(kRelaxed));
  return events.run_rows.load(kRelaxed) >= kRunRows || span >= kRunNs;
}

// Adds rows with stamps from `first` to `last` to the run of a frame that has this version. A step
// back, or of more than `max_step`, begins another run. A repeat of the last stamp adds nothing, so
// neither does another attempt at the same commit.
void follow_run(FrameEvents& events, Version version, Stamp first, Stamp last, std::uint32_t rows,
                std::uint64_t max_step) noexcept {
  const Stamp before = events.run_last.load(kRelaxed);
  const bool is_same = events.run_version.load(kRelaxed) == version;
  if (is_same && last == before) return;
  const bool continues =
      is_same && before < last && (first <= before || span_ns(before, first) <= max_step);
  if (!continues) {
    events.run_version.store(version, kRelaxed);
    events.run_first.store(first, kRelaxed);
    events.run_rows.store(0, kRelaxed);
    events.run_commits.store(0, kRelaxed);
  }
  events.run_last.store(last, kRelaxed);
  events.run_rows.store(events.run_rows.load(kRelaxed) + rows, kRelaxed);
  events.run_commits.store(events.run_commits.load(kRelaxed) + 1, kRelaxed);
}

}  // namespace

// Returns true if the rows of a group, which are all too old, show that its frame's history must
// start over at an earlier time, and records them. Two commits in a row show it if the clock was
// set back, if the history ends ahead of the real-time clock, or if it had jumped ahead from here;
// samples of another clock must continue. Unless the options say so, only the last two restart it.
bool CommitPlan::restarts_history(const FrameWrites& group, Stamp newest) const noexcept {
  FrameEvents& events = tree_.events[group.child];
  const Stamp first = writes_[group.begin].stamp, last = writes_[group.end - 1].stamp;
  follow_run(events, group.frame->version.current() & ~SeqLock::kWriting, first, last,
             group.end - group.begin, limits_.cache_ns);
  if (events.run_commits.load(kRelaxed) < 2) return false;
  const Stamp from = events.jumped_from.load(kRelaxed);
  const bool returns = events.jumped_ahead.load(kRelaxed) && distance_ns(from, last) <= kReturnNs;
  if (returns || is_ahead(newest, real_time_ns(), limits_.cache_ns)) return true;
  if (!tree_.options.clear_on_time_jump) return false;
  return distance_ns(last, newest) <= kOtherClockNs || continues_long(events);
}

// Records that the rows of a group are too old.
void CommitPlan::record_late(const FrameWrites& group, Stamp newest) const noexcept {
  tree_.event_log.add({.kind = TreeEvent::Kind::late,
                       .frame = group.child,
                       .authority = names_.authority(),
                       .stamp = writes_[group.end - 1].stamp,
                       .newest = newest});
}

// Decides on the rows of a group from number `begin` on, which are all far ahead of the newest
// sample. Returns true if they are strays, and refuses them.
bool CommitPlan::refuse_strays(FrameWrites& group, std::uint32_t begin, Stamp newest) noexcept {
  if (is_after_pause(group, writes_[begin].stamp, newest)) return false;
  group.jumps_ahead = jumps_ahead(group, begin, newest);
  if (group.jumps_ahead) return false;
  for (std::uint32_t i = begin; i < group.end; ++i) stored_[writes_[i].row] = RowResult::stray;
  return true;
}

// Returns true if a stamp that is later than the newest by more than the cache time is of the same
// clock: the real-time clock, after a pause, or that of a link whose samples are so far apart.
bool CommitPlan::is_after_pause(const FrameWrites& group, Stamp stamp,
                                Stamp newest) const noexcept {
  const FrameEvents& events = tree_.events[group.child];
  if (span_ns(newest, stamp) / 2 <= events.usual_gap_ns.load(kRelaxed)) return true;
  const Stamp now = real_time_ns();
  // Without a `max_stamp` samples from the future are meant to be stored.
  const bool may_be_ahead = request_.max_stamp == std::numeric_limits<Stamp>::max();
  return is_of_clock(newest, now, limits_.cache_ns) &&
         (may_be_ahead || !is_ahead(stamp, now, limits_.cache_ns));
}

// Returns true if the rows of a group from number `begin` on, which are all far ahead of the
// frame's newest, continue: then time has jumped ahead. Else they are strays, so far.
bool CommitPlan::jumps_ahead(const FrameWrites& group, std::uint32_t begin,
                             Stamp newest) const noexcept {
  FrameEvents& events = tree_.events[group.child];
  const Stamp first = writes_[begin].stamp, last = writes_[group.end - 1].stamp;
  // The samples of a slow link are further apart than the cache time.
  const bool is_same_clock = span_ns(newest, first) <= kOtherClockNs;
  const std::uint64_t max_step = is_same_clock ? kOtherClockNs : std::max(limits_.cache_ns, kRunNs);
  const Stamp before = events.run_last.load(kRelaxed);
  follow_run(events, group.frame->version.current() & ~SeqLock::kWriting, first, last,
             group.end - begin, max_step);
  if (!continues_long(events)) return false;
  const bool is_slow = is_same_clock && before > newest && before < first;
  if (is_slow && span_ns(before, first) > limits_.cache_ns)
    events.usual_gap_ns.store(span_ns(before, first), kRelaxed);
  return true;
}

}  // namespace ztf
