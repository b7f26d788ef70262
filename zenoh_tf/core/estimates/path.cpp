// When the poses of a path were measured.
#include "estimates/path.hpp"

namespace ztf {

namespace {

// A sample cannot have been measured in the future. Stamps that are ahead by less are those of
// samples that came after the caller has read the clock; by more, those of another clock.
constexpr Stamp kLeastAhead = 2'000'000, kMostAhead = 1'000'000'000;  // ns

// Returns how long before the time a repeated pose came first. At rest it is repeated for longer
// than before: then the link counts as measured as often as it was before.
Stamp age_of_repeated(const LinkNow& link, Stamp time) noexcept {
  const Stamp age = time_between(link.run_begin, time);
  const Stamp before = time_between(link.run_before, link.run_begin);
  const bool at_rest = time_between(link.run_begin, link.newest) > before;
  return at_rest ? time_after(link.beyond, std::min(before, age)) : age;
}

}  // namespace

void find_lags(const EstimateQuery& query, PathNow& path) noexcept {
  using Kind = LinkNow::Kind;
  for (LinkNow& link : path.links) {
    if (link.kind == Kind::fixed) continue;
    link.lag = link.beyond = time_between(link.newest, query.stamp);
    Stamp lag = 0;
    if (link.run_begin != kNoStamp && query.stamp >= link.run_begin)
      lag = age_of_repeated(link, query.stamp);
    if (const Stamp ahead = time_between(query.now, link.newest);
        query.now != kNoStamp && ahead > kLeastAhead && ahead < kMostAhead)
      lag = std::max(lag, time_after(link.beyond, ahead));
    if (lag <= link.lag) continue;
    link.kind = Kind::held;
    link.lag = lag;
  }
}

}  // namespace ztf
