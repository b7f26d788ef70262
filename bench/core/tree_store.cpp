// zenoh-tf's stores: the tree, called as the Python module calls it.
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "store.hpp"
#include "tree.hpp"

namespace bench {

namespace {

constexpr ztf::Op op_of(Read kind) {
  switch (kind) {
    case Read::common:
      return ztf::Op::latest_common;
    case Read::latest:
      return ztf::Op::latest;
    default:
      return ztf::Op::latest_xact;
  }
}

class TreeStore final : public Store {
 public:
  TreeStore(std::string name, const Forest& forest, const StoreOptions& options,
            const ztf::Options& tree_options)
      : name_(std::move(name)),
        forest_(forest),
        reversed_(options.reversed),
        tree_(tree_options),
        names_(forest.names.begin(), forest.names.end()) {
    set_all(forest, reversed_, [&](FrameIndex link) { set(link, kStart); });
    for (const std::string_view frame : names_) ids_.push_back(tree_.find(frame));
  }

  std::string name() const override { return name_; }
  bool can(Read) const override { return true; }

  bool read(unsigned thread, Read kind, FrameIndex target, FrameIndex source,
            Stamp& oldest) override {
    ztf::Answer& answer = own_[thread].answer;
    tree_.lookup({op_of(kind), ids_[target], ids_[source]}, answer);
    keep(answer.pose.x);
    oldest = answer.stamp;
    return answer.failure.code == ztf::Code::ok;
  }

  bool ask(Read kind, FrameIndex target, FrameIndex source, Reply& reply) override {
    const bool found = read(0, kind, target, source, reply.stamp);
    reply.pose = own_[0].answer.pose;
    return found;
  }

  void set(FrameIndex link, Stamp stamp) override {
    const std::string_view names[2] = {names_[forest_.parents[link]], names_[link]};
    const ztf::Row row{0, 1, stamp, pose_at(link, stamp)};
    if (commit(names, {&row, 1}) != 1) throw std::runtime_error(name_ + ": not stored");
  }

  unsigned write(unsigned thread, FrameIndex top, unsigned links, Stamp stamp) override {
    std::vector<ztf::Row>& rows = own_[thread].rows;
    rows.resize(links);
    for (std::uint32_t i = 0; i < links; ++i)
      rows[reversed_ ? links - 1 - i : i] = {i, i + 1, stamp, pose_at(top + i + 1, stamp)};
    return commit(std::span(names_).subspan(top, links + 1), rows);
  }

  double mean_newest(unsigned thread, FrameIndex top, unsigned links) override {
    Own& own = own_[thread];
    own.queries.resize(links);
    own.answers.resize(links);
    for (unsigned i = 0; i < links; ++i)
      own.queries[i] = {ztf::Op::latest_xact, ids_[top + i], ids_[top + i + 1]};
    tree_.lookup_transaction(own.queries, own.answers, own.reads);
    double sum = 0;
    for (const ztf::Answer& answer : own.answers) {
      if (answer.failure.code != ztf::Code::ok) return std::nan("");
      sum += static_cast<double>(answer.stamp - kStart);
    }
    return sum / links;
  }

 private:
  struct alignas(128) Own {
    ztf::Answer answer;
    std::vector<ztf::Row> rows;
    std::vector<ztf::Query> queries;
    std::vector<ztf::Answer> answers;
    ztf::ReadSet reads;
  };

  unsigned commit(std::span<const std::string_view> names, std::span<const ztf::Row> rows) {
    std::array<std::uint8_t, 1024> stored;
    const std::span used(stored.data(), rows.size());
    tree_.commit({.names = names, .rows = rows, .authority = "bench", .drop_old = true}, used);
    return std::accumulate(used.begin(), used.end(), 0u);
  }

  const std::string name_;
  const Forest& forest_;
  const bool reversed_;
  ztf::Tree tree_;
  const std::vector<std::string_view> names_;
  std::vector<ztf::FrameId> ids_;
  std::array<Own, kMaxThreads> own_;
};

}  // namespace

std::unique_ptr<Store> make_tree_store(const std::string& concurrency, const Forest& forest,
                                       const StoreOptions& options) {
  ztf::Options tree;
  tree.cache_ns = static_cast<std::uint64_t>(options.cache);
  tree.max_frames = forest.size();
  tree.max_samples_per_frame = options.samples;
  tree.concurrency = concurrency == "giant" ? ztf::Concurrency::giant
                     : concurrency == "2pl" ? ztf::Concurrency::two_phase
                                            : ztf::Concurrency::optimistic;
  return std::make_unique<TreeStore>(concurrency, forest, options, tree);
}

}  // namespace bench
