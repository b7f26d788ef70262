// How the pose is composed, and which bound counts.
#include "estimates/conclude.hpp"

#include "geometry/pose4.hpp"

namespace ztf {

namespace {

using Kind = LinkNow::Kind;
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kHalfTurn = 3.141592653589793;

// The length of the chord of a rotation, at a distance of 1 from its axis.
double chord(double radians) noexcept { return 2 * std::sin(0.5 * std::min(radians, kHalfTurn)); }

Predictor predictor_of(const Backtest* backtest, std::size_t link) noexcept {
  return backtest ? backtest->predictors[link] : Predictor::hold;
}

// What a link is carried on from, and for how many times the time between these samples.
struct Carried {
  std::size_t link;
  const Pose *before, *last;
  double ratio;
};

// Sets the poses of up to four links at once, which takes as long as that of one or two.
ZTF_MULTIVERSION void carry_on_four(std::span<const Carried> links,
                                    std::span<Pose> poses) noexcept {
  Pose4 older, newer;
  Double4 ratio, largest;
  for (std::size_t i = 0; i < 4; ++i) {
    const Carried& c = links[std::min(i, links.size() - 1)];
    const auto put = [i](Pose4& to, const Pose& from) {
      to.x[i] = from.x, to.y[i] = from.y, to.z[i] = from.z;
      to.qx[i] = from.qx, to.qy[i] = from.qy, to.qz[i] = from.qz, to.qw[i] = from.qw;
    };
    put(older, *c.before);
    put(newer, *c.last);
    ratio[i] = c.ratio;
  }
  const Pose4 carried = carry_on_by_series(older, newer, ratio, largest);
  for (std::size_t i = 0; i < links.size(); ++i) {
    const Carried& c = links[i];
    poses[c.link] =
        largest[i] < kSmallSquare ? lane(carried, i) : carry_on(*c.before, *c.last, c.ratio);
  }
}

using Poses = SmallVector<Pose, 16>;

// Sets the pose of each link at the time.
void find_poses(const PathNow& path, const Backtest* backtest, Poses& poses) {
  const std::span<Pose> all(poses.append(path.links.size()), path.links.size());
  Carried carried[4];
  std::size_t n = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const LinkNow& link = path.links[i];
    const Predictor predictor = predictor_of(backtest, i);
    const StampedPose& before =
        link.before[predictor == Predictor::hold ? 0 : static_cast<std::size_t>(predictor) - 1];
    const double ratio = predictor == Predictor::hold
                             ? 0
                             : link.elapsed / elapsed_ns(before.stamp, link.older.stamp);
    if (predictor == Predictor::hold || !(ratio <= kMostRatio)) {
      all[i] = link.pose();
      continue;
    }
    carried[n++] = {i, &before.pose, &link.older.pose, ratio};
    if (n < 4) continue;
    carry_on_four(carried, all);
    n = 0;
  }
  if (n == 1)
    all[carried[0].link] = carry_on(*carried[0].before, *carried[0].last, carried[0].ratio);
  else if (n > 1)
    carry_on_four({carried, n}, all);
}

void find_largest(std::span<const double> shares, const PathNow& path, EstimateAnswer& a) noexcept {
  const auto largest = std::max_element(shares.begin(), shares.end());
  if (largest == shares.end() || !(*largest > 0)) return;
  const LinkNow& link = path.links[static_cast<std::size_t>(largest - shares.begin())];
  a.parent = link.parent;
  a.child = link.child;
}

// Nothing was measured in a gap, so backtests say nothing about the pose there.
void claim_nothing_in_gaps(const PathNow& path, EstimateAnswer& a) noexcept {
  for (const LinkNow& link : path.links) {
    if (!link.in_gap) continue;
    a.metres = a.radians = kInfinite;
    a.level = 0;
    a.backtests = 0;
    a.parent = link.parent;
    a.child = link.child;
  }
}

// Replaces the bounds by those that the limits allow, where these are larger. If all links that
// move have limits, they are guaranteed.
void apply_limits(const EstimateQuery& q, const PathNow& path, const Backtest* backtest,
                  const Poses& poses, std::span<const MotionLimits> limits, EstimateAnswer& a) {
  std::vector<double> shares(path.links.size());
  bool all = true;
  double metres = 0, radians = 0;
  Pose to_source;
  for (std::size_t i = path.links.size(); i-- > 0;) {
    const LinkNow& link = path.links[i];
    const Predictor predictor = predictor_of(backtest, i);
    const Pose& pose = poses.begin()[i];
    if (link.inverted) to_source = inverse(pose) * to_source;
    Residual r{0, 0};
    for (const Residual& part :
         {deviation(link, predictor, pose, limits[i]), clock_deviation(link, limits[i])}) {
      all &= part.metres < kInfinite && part.radians < kInfinite;
      if (part.metres < kInfinite) r.metres += part.metres;
      if (part.radians < kInfinite) r.radians += part.radians;
    }
    // The links after this one may be off, too, and so may the arm be longer.
    const double arm = norm({to_source.x, to_source.y, to_source.z}) + metres;
    shares[i] = r.metres + chord(r.radians) * arm;
    metres += shares[i];
    radians += r.radians;
    if (!link.inverted) to_source = pose * to_source;
  }
  if (all) {
    a.basis = EstimateAnswer::Basis::limits;
    a.level = q.level;
    if (a.backtests == 0) a.metres = a.radians = 0;
  }
  if (metres > a.metres) find_largest(shares, path, a);
  a.metres = std::max(a.metres, metres);
  a.radians = std::max(a.radians, std::min(radians, kHalfTurn));
}

}  // namespace

bool is_too_far(const EstimateQuery& query, const PathNow& path, Failure& failure) noexcept {
  const LinkNow* worst = nullptr;
  for (const LinkNow& link : path.links)
    if (!worst || link.beyond > worst->beyond) worst = &link;
  if (!worst || worst->beyond <= query.max_by) return false;
  failure = {.code = Code::forward,
             .target = query.target,
             .source = query.source,
             .frame = worst->child,
             .parent = worst->parent,
             .stamp = query.stamp,
             .oldest = worst->oldest,
             .newest = worst->newest};
  return true;
}

bool may_err(const PathNow& path) noexcept {
  return std::any_of(path.links.begin(), path.links.end(), [](const LinkNow& link) {
    return link.kind != Kind::fixed && (link.kind != Kind::exact || link.clock_error > 0);
  });
}

void conclude(const EstimateQuery& q, const PathNow& path, const Backtest* backtest,
              std::span<const MotionLimits> limits, EstimateAnswer& a) {
  a.pose = {};
  a.by = 0;
  a.parent = a.child = 0;
  a.carried.clear();
  bool is_static = true;
  Poses poses;
  find_poses(path, backtest, poses);
  for (std::size_t i = 0; i < path.links.size(); ++i) {
    const LinkNow& link = path.links[i];
    const Predictor predictor = predictor_of(backtest, i);
    const Pose& pose = poses[i];
    a.pose = i == 0 ? (link.inverted ? inverse(pose) : pose)
                    : a.pose * (link.inverted ? inverse(pose) : pose);
    a.by = std::max(a.by, link.beyond);
    if (link.beyond > 0) a.carried.push_back({link.child, predictor != Predictor::hold});
    is_static &= link.kind == Kind::fixed;
  }
  a.basis = is_static ? EstimateAnswer::Basis::is_static : EstimateAnswer::Basis::backtest;
  a.metres = a.radians = 0;
  a.level = 1;
  a.backtests = 0;
  if (!backtest) return;
  const ErrorBound::Value bound = backtest->bound.at(q.level);
  a.metres = bound.metres;
  a.radians = bound.radians;
  a.level = bound.level;
  a.backtests = bound.backtests;
  find_largest(backtest->shares, path, a);
  claim_nothing_in_gaps(path, a);
  if (!limits.empty()) apply_limits(q, path, backtest, poses, limits, a);
  a.metres += q.radius * chord(a.radians);
}

}  // namespace ztf
