// Which past instants are compared, and what a link had at them.
#include "estimates/cases.hpp"

namespace ztf {

namespace {

constexpr double kSecond = 1e9;  // ns
// As many instants as a level needs; more cost time and say the same.
constexpr std::size_t kFew = 200, kMany = 1000;
constexpr double kLevelOfFew = 0.99;

}  // namespace

std::uint32_t lag_bucket(Stamp lag) noexcept {
  if (lag <= 0) return 0;
  int octave;
  const double mantissa = std::frexp(static_cast<double>(lag) * (1e-6 * (1 - 1e-9)), &octave);
  if (octave < 1) return 1;
  // The quarters of an octave, by a mantissa from 0.5 to 1.
  int quarter = 0;
  for (const double edge : {0.5, 0.5946035575013605, 0.7071067811865476, 0.8408964152537146})
    quarter += mantissa > edge;
  return static_cast<std::uint32_t>(4 * (octave - 1) + quarter + 1);
}

Stamp longest_lag(std::uint32_t bucket) noexcept {
  if (bucket == 0) return 0;
  const double lag = 1e6 * std::exp2(0.25 * (bucket - 1));
  return lag < 9e18 ? static_cast<Stamp>(lag) : std::numeric_limits<Stamp>::max();
}

unsigned window_class(double level) noexcept {
  unsigned window = 0;
  while (window < 20 && window_s(window) * (1 - level) < 0.6) ++window;
  return window;
}

double window_s(unsigned window) noexcept { return 10.0 * (1u << window); }

double independent(double span_s, double lag_s) noexcept {
  return std::floor(span_s / std::max(lag_s, kIndependent));
}

Stamp longest_lag(const PathNow& path) noexcept {
  Stamp longest = 0;
  for (const LinkNow& link : path.links) longest = std::max(longest, link.lag);
  return longest_lag(lag_bucket(longest));
}

Stamp grid_of(const PathNow& path) noexcept {
  Stamp newest = std::numeric_limits<Stamp>::max();
  for (const LinkNow& link : path.links)
    if (link.kind != LinkNow::Kind::fixed) newest = std::min(newest, link.newest);
  return newest / kGrid - (newest % kGrid < 0);
}

namespace detail {

namespace {

// Returns whether sample i, which is not the newest, is followed by a gap.
bool precedes_gap(const SampleRun& run, std::uint32_t i) noexcept {
  return is_gap(elapsed_ns(run.stamp(i), run.stamp(i + 1)), elapsed_ns(run.stamp(0), run.newest()),
                run.size());
}

// Leaves out the instants in gaps, at which nothing was measured that an error could be counted
// from.
void drop_unmeasured(std::span<const SampleRun> runs, const PathNow& path,
                     std::vector<Stamp>& times, Cases& cases) {
  const std::size_t all = times.size();
  std::vector<bool> measured(all, true);
  const SampleRun* run = runs.data();
  for (const LinkNow& link : path.links) {
    if (link.kind == LinkNow::Kind::fixed) continue;
    const Stamp lag = longest_lag(lag_bucket(link.lag));
    std::uint32_t at = 0, cut = 0;
    for (std::size_t i = all; i-- > 0;) {  // from the oldest on
      at = run->last_at(times[i], at);
      if (at + 1 < run->size() && precedes_gap(*run, at)) measured[i] = false;
      if (link.kind != LinkNow::Kind::carried) continue;
      cut = run->last_at(times[i] - lag, cut);
      const std::uint32_t compared = run->last_at(run->stamp(cut) + lag, cut);
      if (compared < at && precedes_gap(*run, compared)) measured[i] = false;
    }
    ++run;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < all; ++i) {
    if (!measured[i]) continue;
    times[kept] = times[i];
    cases.age_s[kept++] = cases.age_s[i];
  }
  times.resize(kept);
  cases.age_s.resize(kept);
  cases.span_s *= static_cast<double>(kept) / static_cast<double>(all);
}

}  // namespace

std::vector<Stamp> choose_times(std::span<const SampleRun> runs, const PathNow& path,
                                double window_s, Cases& cases) {
  cases.age_s.clear();
  cases.span_s = 0;
  Stamp begin = kNoStamp + 1, end = std::numeric_limits<Stamp>::max();
  const SampleRun* run = runs.data();
  for (const LinkNow& link : path.links) {
    if (link.kind == LinkNow::Kind::fixed) continue;
    // The neighbours of a sample that is left out must be there.
    const bool leaves_out = link.kind == LinkNow::Kind::between;
    if (run->size() < (leaves_out ? 3 : 2)) return {};
    // So are those before the sample that is carried on, where the history is long enough.
    const std::uint32_t before = link.kind == LinkNow::Kind::carried
                                     ? std::min(kTwistSteps[kTwists - 1], run->size() / 4)
                                     : 0;
    const Stamp lag = longest_lag(lag_bucket(link.lag));
    begin = std::max(begin, time_after(run->stamp(before), std::max(lag, link.clock_error)));
    end = std::min(end, run->newest());
    ++run;
  }
  if (end <= begin) return {};
  const double most = std::min(window_s * kSecond, elapsed_ns(begin, end));
  // Instants are counted from a grid, so that the same history gives the same instants.
  const Stamp past_grid = ((end % kGrid) + kGrid) % kGrid;
  const Stamp on_grid = end > kNoStamp + kGrid ? end - past_grid : end;
  if (on_grid > begin && elapsed_ns(begin, on_grid) > 0.5 * most) end = on_grid;
  const double span = std::min(most, elapsed_ns(begin, end));
  cases.span_s = span / kSecond;
  const double n = independent(cases.span_s, static_cast<double>(longest_lag(path)) / kSecond);
  const std::size_t instants = n / (n + 1) > kLevelOfFew ? kMany : kFew;
  std::vector<Stamp> times(instants);
  cases.age_s.resize(instants);
  for (std::size_t i = 0; i < instants; ++i) {
    // The golden ratio keeps the instants out of step with any rate of samples.
    const double golden = static_cast<double>(i) * 0.6180339887498949;
    const double share =
        (static_cast<double>(i) + golden - std::floor(golden)) / static_cast<double>(instants);
    times[i] = end - static_cast<Stamp>(share * span);
    cases.age_s[i] = share * cases.span_s;
  }
  drop_unmeasured(runs, path, times, cases);
  return times;
}

namespace {

// A clock that is off by some time shows the pose of that time before or after. So the link was
// wrong by what it moved within it: the larger one of both directions, of one for the newest.
Residual moved_within(const SampleRun& run, Stamp error, Stamp time, const Pose& truth) noexcept {
  Residual most{0, 0};
  for (const Stamp other : {time_before(time, error), time_after(time, error)}) {
    const Residual r = residual_between(truth, run.pose_at(other, run.last_at(other, 0)));
    most = {std::max(most.metres, r.metres), std::max(most.radians, r.radians)};
  }
  return most;
}

}  // namespace

void copy_link_cases(const SampleRun& run, const LinkNow& link, std::span<const Stamp> times,
                     Case* out) noexcept {
  using Kind = LinkNow::Kind;
  const Stamp lag = longest_lag(lag_bucket(link.lag));
  std::uint32_t at = 0, cut = 0;
  for (std::size_t i = times.size(); i-- > 0;) {
    Case& c = out[i];
    Stamp time = times[i];
    at = run.last_at(time, at);
    c.by_clock = {0, 0};
    if (link.clock_error > 0)
      c.by_clock = moved_within(run, link.clock_error, time, run.pose_at(time, at));
    if (link.kind == Kind::between) {
      const std::uint32_t left_out = std::clamp(at, 1u, run.size() - 2);
      const Stamp from = run.stamp(left_out - 1), to = run.stamp(left_out + 1);
      c.truth = run.pose(left_out);
      c.last = interpolate(run.pose(left_out - 1), run.pose(left_out + 1),
                           elapsed_ns(from, run.stamp(left_out)) / elapsed_ns(from, to));
      continue;
    }
    c.truth = run.pose_at(time, at);
    if (link.kind == Kind::exact) {
      c.last = c.truth;
      continue;
    }
    cut = run.last_at(time - lag, cut);
    c.last = run.pose(cut);
    if (link.kind == Kind::held) continue;
    time = run.stamp(cut) + lag;
    c.truth = run.pose_at(time, run.last_at(time, cut));
    const auto carried = static_cast<double>(lag);
    for (std::size_t t = 0; t < kTwists; ++t) {
      const std::uint32_t before = cut - std::min(kTwistSteps[t], cut);
      c.before[t] = run.pose(before);
      c.ratios[t] = carried / elapsed_ns(run.stamp(before), run.stamp(cut));
    }
  }
}

}  // namespace detail

}  // namespace ztf
