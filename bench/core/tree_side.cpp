// zenoh-tf's side: the tree, called as the Python module calls it.
#include <array>
#include <stdexcept>

#include "side.hpp"
#include "tree.hpp"

namespace bench {

namespace {

class TreeSide final : public Side {
 public:
  TreeSide(std::string name, const ztf::Options& options) : name_(std::move(name)), tree_(options) {
    const std::vector<Link> all = links();
    for (int k = 0; k < kSamples; ++k) {
      for (std::size_t i = 0; i < all.size(); ++i)
        set(all[i], kStart + all[i].offset + k * kPeriod, pose_of(i, k));
      for (unsigned t = 0; t < kMaxThreads; ++t)
        set(link_to_set(t), kStart + k * kPeriod, pose_of(t, k));
    }
    next_.fill(kSamples);
  }

  std::string name() const override { return name_; }

  Reply ask(const std::string& target, const std::string& source,
            std::optional<Stamp> time) override {
    ztf::Answer answer;
    const ztf::Op op = time ? ztf::Op::at : ztf::Op::latest_common;
    tree_.lookup({op, tree_.find(target), tree_.find(source), time.value_or(ztf::kNoStamp)},
                 answer);
    if (answer.failure.code != ztf::Code::ok) throw std::runtime_error(name_ + ": no answer");
    return {answer.pose, answer.stamp};
  }

  void run(const Case& what, std::size_t calls, unsigned thread) override {
    if (what.kind == Kind::set) return run_sets(calls, thread);
    const ztf::FrameId target = tree_.find(what.target), source = tree_.find(what.source);
    const std::vector<Stamp>& when = times();
    ztf::Answer answer;
    switch (what.kind) {
      case Kind::common_ids:
        for (std::size_t i = 0; i < calls; ++i) {
          tree_.lookup({ztf::Op::latest_common, target, source}, answer);
          keep(answer.pose.x);
        }
        break;
      case Kind::common_names:
        for (std::size_t i = 0; i < calls; ++i) {
          tree_.lookup({ztf::Op::latest_common, tree_.find(what.target), tree_.find(what.source)},
                       answer);
          keep(answer.pose.x);
        }
        break;
      default:
        for (std::size_t i = 0; i < calls; ++i) {
          tree_.lookup({ztf::Op::at, target, source, when[(i + thread * 97) % kTimes]}, answer);
          keep(answer.pose.x);
        }
    }
    if (answer.failure.code != ztf::Code::ok) throw std::runtime_error(name_ + ": no answer");
  }

 private:
  void run_sets(std::size_t calls, unsigned thread) {
    const Link link = link_to_set(thread);
    const ztf::Pose pose = pose_of(thread, 0);
    for (std::size_t i = 0; i < calls; ++i) set(link, kStart + next_[thread]++ * kPeriod, pose);
  }

  void set(const Link& link, Stamp stamp, const ztf::Pose& pose) {
    const std::string_view names[2] = {link.parent, link.child};
    const ztf::Row row{0, 1, stamp, pose};
    std::uint8_t stored = 0;
    tree_.commit({.names = names, .rows = {&row, 1}, .authority = "bench", .drop_old = true},
                 {&stored, 1});
    if (!stored) throw std::runtime_error(name_ + ": not stored");
  }

  const std::string name_;
  ztf::Tree tree_;
  std::array<Stamp, kMaxThreads> next_;  // sample of each thread's own link
};

}  // namespace

std::unique_ptr<Side> make_tree_side(const std::string& concurrency) {
  ztf::Options options;
  options.cache_ns = kCache;
  options.concurrency = concurrency == "giant" ? ztf::Concurrency::giant
                        : concurrency == "2pl" ? ztf::Concurrency::two_phase
                                               : ztf::Concurrency::optimistic;
  return std::make_unique<TreeSide>(concurrency, options);
}

}  // namespace bench
