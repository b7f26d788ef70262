// How the pose is composed, and which bound counts.
#include "estimates/conclude.hpp"

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

Pose pose_of(const LinkNow& link, Predictor predictor) noexcept {
  if (predictor == Predictor::hold) return link.pose();
  const StampedPose& before = link.before[static_cast<std::size_t>(predictor) - 1];
  const double ratio = link.elapsed / elapsed_ns(before.stamp, link.older.stamp);
  return predict(predictor, link.older.pose, before.pose, ratio);
}

void find_largest(std::span<const double> shares, const PathNow& path, EstimateAnswer& a) noexcept {
  const auto largest = std::max_element(shares.begin(), shares.end());
  if (largest == shares.end() || !(*largest > 0)) return;
  const LinkNow& link = path.links[static_cast<std::size_t>(largest - shares.begin())];
  a.parent = link.parent;
  a.child = link.child;
}

// Replaces the bounds by those that the limits allow, where these are larger. If all links that
// move have limits, they are guaranteed.
void apply_limits(const EstimateQuery& q, const PathNow& path, const Backtest* backtest,
                  std::span<const MotionLimits> limits, EstimateAnswer& a) {
  std::vector<double> shares(path.links.size());
  bool all = true;
  double metres = 0, radians = 0;
  Pose to_source;
  for (std::size_t i = path.links.size(); i-- > 0;) {
    const LinkNow& link = path.links[i];
    const Predictor predictor = predictor_of(backtest, i);
    const Pose pose = pose_of(link, predictor);
    if (link.inverted) to_source = inverse(pose) * to_source;
    Residual r = deviation(link, predictor, pose, limits[i]);
    all &= r.metres < kInfinite && r.radians < kInfinite;
    if (r.metres == kInfinite) r.metres = 0;
    if (r.radians == kInfinite) r.radians = 0;
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
    return link.kind != Kind::fixed && link.kind != Kind::exact;
  });
}

void conclude(const EstimateQuery& q, const PathNow& path, const Backtest* backtest,
              std::span<const MotionLimits> limits, EstimateAnswer& a) {
  a.pose = {};
  a.by = 0;
  a.parent = a.child = 0;
  a.carried.clear();
  bool is_static = true;
  for (std::size_t i = 0; i < path.links.size(); ++i) {
    const LinkNow& link = path.links[i];
    const Predictor predictor = predictor_of(backtest, i);
    const Pose pose = pose_of(link, predictor);
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
  if (!limits.empty()) apply_limits(q, path, backtest, limits, a);
  a.metres += q.radius * chord(a.radians);
}

}  // namespace ztf
