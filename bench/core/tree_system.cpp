// zenoh-tf's tree, called as the Python module calls it.
#include <numeric>

#include "system.hpp"
#include "tree.hpp"

namespace bench {

namespace {

// By Read.
constexpr ztf::Op kOps[] = {ztf::Op::latest_common, ztf::Op::latest_common, ztf::Op::latest_xact,
                            ztf::Op::at};

class TreeSystem final : public System {
 public:
  TreeSystem(const Names& names, const Settings& settings, const ztf::Options& options)
      : child_to_parent_(settings.count("child_to_parent") != 0),
        pose_at_(settings.number("rad_per_ms")),
        tree_(options),
        names_(names.begin(), names.end()) {}

  bool has_transactions() const override { return true; }

  void resolve_ids() override {
    for (const std::string_view name : names_) ids_.push_back(tree_.find(name));
  }

  unsigned lookup(Read read, const Request* requests, unsigned count, Reply& last) override {
    const bool by_name = read == Read::latest_common_by_name;
    const ztf::Op op = kOps[static_cast<int>(read)];
    unsigned found = 0;
    ztf::Answer answer;
    for (unsigned i = 0; i < count; ++i) {
      const auto& [target, source, time] = requests[i];
      tree_.lookup({op, by_name ? tree_.find(names_[target]) : ids_[target],
                    by_name ? tree_.find(names_[source]) : ids_[source], time},
                   answer);
      keep(answer.pose.x);
      found += answer.failure.code == ztf::Code::ok;
    }
    last = {answer.pose, answer.stamp};
    return found;
  }

  unsigned write(FrameIndex first, unsigned links, Stamp stamp) override {
    static thread_local std::vector<ztf::Row> rows;
    static thread_local std::vector<std::uint8_t> stored;
    rows.resize(links);
    stored.resize(links);
    for (unsigned i = 0; i < links; ++i)
      rows[child_to_parent_ ? links - 1 - i : i] = {i, i + 1, stamp, pose_at_(first + i, stamp)};
    const auto names = std::span(names_).subspan(first - 1, links + 1);
    tree_.commit({.names = names, .rows = rows, .authority = "bench", .drop_old = true}, stored);
    return std::accumulate(stored.begin(), stored.end(), 0u);
  }

  void grasp(Stamp stamp) override {
    const std::string_view names[] = {names_.front(), names_.back(), kGrasped};
    for (const std::uint32_t parent : {0u, 1u}) {
      const ztf::Row row{parent, 2, stamp + parent, pose_at_(0, stamp)};
      std::uint8_t stored = 0;
      tree_.commit({.names = names, .rows = {&row, 1}, .authority = "bench"}, {&stored, 1});
    }
  }

 private:
  const bool child_to_parent_;
  const Motion pose_at_;
  ztf::Tree tree_;
  const std::vector<std::string_view> names_;
  std::vector<ztf::FrameId> ids_;
};

}  // namespace

std::unique_ptr<System> make_tree_system(const Names& names, const Settings& settings) {
  const std::string& concurrency = settings.at("system");
  ztf::Options options;
  options.cache_ns = static_cast<std::uint64_t>(settings.number("cache_s") * 1e9);
  options.max_frames = static_cast<unsigned>(names.size() + 1);
  options.max_samples_per_frame = settings.count("max_samples");
  options.max_depth = 0;  // no limit
  options.concurrency = concurrency == "giant" ? ztf::Concurrency::giant
                        : concurrency == "2pl" ? ztf::Concurrency::two_phase
                                               : ztf::Concurrency::optimistic;
  return std::make_unique<TreeSystem>(names, settings, options);
}

}  // namespace bench
