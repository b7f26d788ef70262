// How the predictors are chosen, and the errors of the whole path computed.
#include "estimates/backtest.hpp"

#include <algorithm>

namespace ztf {

namespace {

constexpr double kQuantile = 0.9;  // of the errors that predictors are compared by
constexpr double kClearly = 0.9;  // a predictor replaces another one if its errors are less by that
constexpr double kArm = 1;        // metres that a rotation counts at, where predictors are compared
constexpr double kLeastArm = 0.1;      // the same where links are compared, at least
constexpr std::size_t kCompared = 50;  // instants that predictors are compared by

Pose predict_case(Predictor predictor, const Case& c) noexcept {
  if (predictor == Predictor::hold) return c.last;
  const auto twist = static_cast<std::size_t>(predictor) - 1;
  return predict(predictor, c.last, c.before[twist], c.ratios[twist]);
}

// The quantile of a predictor's errors, of about kCompared cases.
double error_of(Predictor predictor, std::span<const Case> cases) {
  std::vector<double> scores;
  const std::size_t step = std::max<std::size_t>(cases.size() / kCompared, 1);
  for (std::size_t i = 0; i < cases.size(); i += step) {
    const Residual r = residual_between(cases[i].truth, predict_case(predictor, cases[i]));
    scores.push_back(r.metres + r.radians * kArm);
  }
  return quantile(scores, kQuantile);
}

// Chooses by the errors of all cases, and as much by those of the newest: so a link that starts
// after a rest is not held for long, and what happens rarely is not forgotten.
Predictor choose(std::span<const Case> cases, std::size_t newest, const Predictor* before) {
  double errors[kPredictors];
  std::size_t best = 0;
  for (std::size_t p = 0; p < kPredictors; ++p) {
    const auto predictor = static_cast<Predictor>(p);
    errors[p] = error_of(predictor, cases) + error_of(predictor, cases.first(newest));
    if (errors[p] < errors[best]) best = p;
  }
  if (before && errors[best] > kClearly * errors[static_cast<std::size_t>(*before)]) return *before;
  return static_cast<Predictor>(best);
}

// The product of a path's factors at each instant, one more at a time.
class Products {
 public:
  explicit Products(std::size_t instants) : truth(instants), guess(instants) {}
  void multiply(std::size_t i, bool inverted, const Pose& true_pose, const Pose& guessed) noexcept {
    truth[i] = truth[i] * (inverted ? inverse(true_pose) : true_pose);
    guess[i] = guess[i] * (inverted ? inverse(guessed) : guessed);
  }
  std::vector<Pose> truth, guess;
};

// What wrong clocks add to the errors of the path. No residual shows it, as stamps are compared
// with stamps: the truth of a backtest is what the clocks say. The real pose is off from that by
// what each link moves while its clock is wrong, whatever the predictor. So this is added to the
// residual of each instant, and the quantile of the sums holds at the level: clocks of several
// links may be off in different directions, so their parts are added as well.
class ClockErrors {
 public:
  // Of a link before the later factors are known: `child` is the link's child in the target.
  void add(std::size_t i, const Residual& by_clock, const Pose& child) {
    parts_.push_back({i, by_clock, {child.x, child.y, child.z}});
  }
  // A link's rotation moves the source by its distance from the link's child.
  void apply(std::span<const Pose> source, std::span<Residual> errors) const noexcept {
    for (const Part& part : parts_) {
      const Pose& at = source[part.instant];
      const double arm = norm({at.x - part.child.x, at.y - part.child.y, at.z - part.child.z});
      errors[part.instant].metres +=
          part.moved.metres + 2 * std::sin(0.5 * part.moved.radians) * arm;
      errors[part.instant].radians += part.moved.radians;
    }
  }

 private:
  struct Part {
    std::size_t instant;
    Residual moved;
    Vec3 child;
  };
  std::vector<Part> parts_;
};

}  // namespace

Backtest backtest(const PathNow& path, const Cases& cases, const Backtest* before) {
  using Kind = LinkNow::Kind;
  const std::size_t links = path.links.size(), instants = cases.size();
  std::vector<Predictor> predictors(links, Predictor::hold);
  std::vector<Residual> own(links);  // the quantiles of each link's own errors
  std::vector<Residual> errors(instants);
  std::vector<double> values(instants);
  Products products(instants);
  ClockErrors clocks;
  const Case* next = cases.cases.data();
  const double lag_s = static_cast<double>(longest_lag(path)) * 1e-9;
  // At least one, also where a gap fills the window.
  const std::size_t newest =
      std::max<std::size_t>(newest_within(cases.age_s, newest_window_s(lag_s)), 1);
  for (std::size_t l = 0; l < links && instants > 0; ++l) {
    const LinkNow& link = path.links[l];
    if (link.kind == Kind::fixed) {
      const Pose pose = link.pose();
      for (std::size_t i = 0; i < instants; ++i) products.multiply(i, link.inverted, pose, pose);
      continue;
    }
    const std::span<const Case> of_link(next, instants);
    next += instants;
    if (link.kind == Kind::carried)
      predictors[l] = choose(of_link, newest, before ? &before->predictors[l] : nullptr);
    for (std::size_t i = 0; i < instants; ++i) {
      const Pose guess = predict_case(predictors[l], of_link[i]);
      const Residual r = residual_between(of_link[i].truth, guess), &by = of_link[i].by_clock;
      errors[i] = {r.metres + by.metres, r.radians + by.radians};
      const bool wrong_clock = link.clock_error > 0;
      if (wrong_clock && link.inverted) clocks.add(i, by, products.truth[i]);
      products.multiply(i, link.inverted, of_link[i].truth, guess);
      if (wrong_clock && !link.inverted) clocks.add(i, by, products.truth[i]);
    }
    for (std::size_t i = 0; i < instants; ++i) values[i] = errors[i].metres;
    own[l].metres = quantile(values, kQuantile);
    for (std::size_t i = 0; i < instants; ++i) values[i] = errors[i].radians;
    own[l].radians = quantile(values, kQuantile);
  }
  for (std::size_t i = 0; i < instants; ++i)
    errors[i] = residual_between(products.truth[i], products.guess[i]);
  clocks.apply(products.truth, errors);

  // A link's rotation moves the source by its distance from the link's child.
  std::vector<double> shares(links);
  Pose to_source;
  for (std::size_t l = links; l-- > 0;) {
    const LinkNow& link = path.links[l];
    const Pose next_to_source = (link.inverted ? inverse(link.pose()) : link.pose()) * to_source;
    if (link.inverted) to_source = next_to_source;
    const double arm = std::max(norm({to_source.x, to_source.y, to_source.z}), kLeastArm);
    shares[l] = own[l].metres + 2 * std::sin(0.5 * own[l].radians) * arm;
    to_source = next_to_source;
  }
  return {ErrorBound(errors, cases.age_s, cases.span_s, lag_s), std::move(predictors),
          std::move(shares)};
}

}  // namespace ztf
