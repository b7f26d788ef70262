// A tree with shortcuts for tests: names instead of ids, one call for each step.
//
// Thread safety: every function, from any thread, as the tree's.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "check.hpp"
#include "tree.hpp"

namespace ztf {

struct Set {
  std::string parent, child;
  Stamp stamp;
  Pose pose = {};
};

struct SetOptions {
  std::string authority = {};
  bool is_static = false;
  bool drop_old = false;
  std::vector<std::pair<std::string, Version>> reads = {};
  std::int64_t expires_ns = kNeverExpires;
  Stamp max_stamp = std::numeric_limits<Stamp>::max();
};

// Calls body() and returns why it was rejected, if it was.
template <class Body>
std::optional<Rejected> rejection(Body&& body) {
  try {
    body();
  } catch (Rejected& rejected) {
    return std::move(rejected);
  }
  return std::nullopt;
}

template <class Number>
std::string nth(const std::string& prefix, Number n) {
  return prefix + std::to_string(n);
}

inline Pose at_x(double x) { return {x, 0, 0, 0, 0, 0, 1}; }

// A pose that differs with n, and has no symmetry that could hide a mistake.
inline Pose some_pose(int n) {
  Pose p{0.3 * n + 1, 2.0 - 0.7 * n, 0.11 * n * n, 0.2 + 0.1 * (n % 5), -0.4, 0.3 * (n % 3), 0.6};
  const double scale = 1 / std::sqrt(p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw);
  p.qx *= scale;
  p.qy *= scale;
  p.qz *= scale;
  p.qw *= scale;
  return p;
}

inline double distance(const Pose& a, const Pose& b) {
  const double sign = a.qx * b.qx + a.qy * b.qy + a.qz * b.qz + a.qw * b.qw < 0 ? -1 : 1;
  double most = 0;
  for (const double d : {a.x - b.x, a.y - b.y, a.z - b.z, a.qx - sign * b.qx, a.qy - sign * b.qy,
                         a.qz - sign * b.qz, a.qw - sign * b.qw})
    most = std::isnan(d) ? INFINITY : std::max(most, std::abs(d));
  return most;
}

class World {
 public:
  explicit World(const Options& options = {}) : tree(small(options)) {}
  explicit World(Concurrency concurrency) : World(Options{.concurrency = concurrency}) {}

  Tree tree;

  // Returns why the commit was rejected, if it was.
  std::optional<Rejected> commit(const std::vector<Set>& sets, const SetOptions& options = {},
                                 std::vector<std::uint8_t>* stored = nullptr) {
    std::vector<std::string_view> names, read_names;
    std::vector<Row> rows;
    std::vector<Version> read_versions;
    for (const Set& set : sets) {
      const auto row = static_cast<std::uint32_t>(names.size());
      names.push_back(set.parent);
      names.push_back(set.child);
      rows.push_back({row, row + 1, set.stamp, set.pose});
    }
    for (const auto& [name, version] : options.reads) {
      read_names.push_back(name);
      read_versions.push_back(version);
    }
    std::vector<std::uint8_t> flags(sets.size());
    auto rejected = rejection([&] {
      tree.commit({.names = names,
                   .rows = rows,
                   .authority = options.authority,
                   .is_static = options.is_static,
                   .drop_old = options.drop_old,
                   .read_names = read_names,
                   .read_versions = read_versions,
                   .expires_ns = options.expires_ns,
                   .max_stamp = options.max_stamp},
                  flags);
    });
    if (stored && !rejected) *stored = flags;
    return rejected;
  }
  // Commits one row by references, where parent is the first.
  std::optional<Rejected> append(const std::vector<NameRef>& frames, Stamp stamp, const Pose& pose,
                                 const std::string& authority = {}) {
    const Row row{0, 1, stamp, pose};
    std::uint8_t stored = 0;
    return rejection([&] {
      tree.commit({.names = {},
                   .rows = {&row, 1},
                   .frames = frames,
                   .authority = authority,
                   .drop_old = true},
                  {&stored, 1});
    });
  }
  // Returns true if the row was stored, false if it was dropped as too old. Fails the test
  // otherwise.
  bool set(const std::string& parent, const std::string& child, Stamp stamp, const Pose& pose = {},
           bool is_static = false) {
    std::vector<std::uint8_t> stored;
    const auto refused =
        commit({{parent, child, stamp, pose}}, {.is_static = is_static, .drop_old = true}, &stored);
    if (refused) check::fail(__FILE__, __LINE__, refused->message);
    return !refused && stored[0];
  }
  Code refusal(const std::vector<Set>& sets, const SetOptions& options = {}) {
    const auto refused = commit(sets, options);
    return refused ? refused->code : Code::ok;
  }
  // Returns why the removal was rejected, if it was.
  std::optional<Rejected> remove(std::string_view name, bool subtree = false) {
    return rejection([&] { tree.remove_frame(name, subtree); });
  }
  // Fails the test if the commit is rejected.
  void accept(const std::vector<Set>& sets, const SetOptions& options = {},
              const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
    if (const auto refused = commit(sets, options)) check::fail(file, line, refused->message);
  }

  [[nodiscard]] FrameId id(const std::string& name) const { return tree.find(name); }
  [[nodiscard]] FrameInfo info(const std::string& name) const { return tree.info(id(name)); }
  [[nodiscard]] Version version(const std::string& name) const { return tree.version(id(name)); }
  [[nodiscard]] const FrameEvents& events(const std::string& name) const {
    return tree.events(id(name));
  }
  // All of a tree that a rejected commit must leave unchanged. Hangs if a frame was left locked.
  [[nodiscard]] std::string state() const {
    std::ostringstream text;
    for (FrameId id = 1; id <= tree.size(); ++id) {
      const FrameInfo i = tree.info(id);
      text << tree.name(id) << ' ' << i.parent << ' ' << i.is_static << ' ' << i.samples << ' '
           << i.oldest << ' ' << i.newest << ' ' << i.version << ' ' << i.authority << '\n';
    }
    return text.str();
  }
  [[nodiscard]] Query query(Op op, const std::string& target, const std::string& source,
                            Stamp stamp = kNoStamp) const {
    return {op, id(target), id(source), stamp};
  }
  [[nodiscard]] Answer ask(Op op, const std::string& target, const std::string& source,
                           Stamp stamp = kNoStamp) const {
    Answer answer;
    tree.lookup(query(op, target, source, stamp), answer);
    return answer;
  }
  [[nodiscard]] Answer at(const std::string& target, const std::string& source, Stamp stamp) const {
    return ask(Op::at, target, source, stamp);
  }
  [[nodiscard]] Code code(Op op, const std::string& target, const std::string& source,
                          Stamp stamp = kNoStamp) const {
    return ask(op, target, source, stamp).failure.code;
  }
  // Runs the query as a transaction and returns its read set.
  std::vector<std::pair<std::string, Version>> reads_of(const Query& q, Answer& answer) const {
    ReadSet reads;
    tree.lookup_transaction({&q, 1}, {&answer, 1}, reads);
    std::vector<std::pair<std::string, Version>> named;
    for (const ReadVersion& read : reads)
      named.emplace_back(std::string(tree.name(read.frame)), read.version);
    return named;
  }

 private:
  // Sanitizers pay for unused memory, too.
  static Options small(Options options) {
    options.max_frames = std::min(options.max_frames, 4096u);
    return options;
  }
};

// A parked lookup that counts how often it is woken.
class CountingWaiter final : public Waiter {
 public:
  CountingWaiter(const World& w, Op op, std::string_view target, std::string_view source,
                 Stamp stamp = kNoStamp)
      : Waiter({op, 0, 0, stamp}, target, source), tree_(w.tree) {}
  // From the source at its time, through the fixed frame, to the target at its time.
  CountingWaiter(const World& w, std::string_view target, Stamp target_stamp,
                 std::string_view fixed, std::string_view source, Stamp source_stamp)
      : Waiter({Op::full, 0, 0, target_stamp, 0, source_stamp}, target, source, fixed),
        tree_(w.tree) {}
  ~CountingWaiter() override { cancel(); }

  bool lookup_or_park() { return tree_.lookup_or_park(*this); }
  bool cancel() { return tree_.wait_list().cancel(*this); }
  [[nodiscard]] Code code() const { return answer().failure.code; }
  int woken = 0;

 private:
  void notify() noexcept override { ++woken; }
  const Tree& tree_;
};

template <class Body>
void for_each_concurrency(Body&& body) {
  for (const auto c : {Concurrency::optimistic, Concurrency::two_phase, Concurrency::giant})
    body(c);
}

// A test that runs in each mode of concurrency control, `c`.
#define TEST_EACH_MODE(name)                                                                   \
  static void name(Concurrency);                                                               \
  static const check::Registered registered_##name(#name, [] { for_each_concurrency(name); }); \
  static void name([[maybe_unused]] Concurrency c)

}  // namespace ztf
