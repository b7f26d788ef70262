// Names that come and go in a tree with few more ids than frames, so that ids pass on all the time.
//
// A name's link to the root has its writer's stamp as x, and the name's number as y. So a pose says
// which write it is of, and whether it is another name's.
// - Ordered names: their writes, removals included, are accesses of the history. A mutex for each
//   name gives its writes the order of their stamps. Readers take none, nor do transactions while
//   they read.
// - Unordered names: any thread writes, removes and reads them at any time. Only their poses are
//   checked.
// - A mover leaves parents that are removed then, so that its past links lead to freed ids.
//
// Thread safety: every function, from any thread.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tree.hpp"

namespace ztf {

class Churn {
 public:
  static constexpr int kNames = 6;  // of each kind

  // What a step has read and written of ordered names; stamp 0: the state before the history.
  struct Access {
    bool is_write;
    int name;
    Stamp stamp;
  };
  struct Result {
    std::optional<Code> rejected = {};
    bool is_nonsense = false;
    std::vector<Access> accesses = {};
  };

  // Requires a tree that has the frame `root`, which nobody removes.
  Churn(Tree& tree, const std::string& root) : tree_(tree), root_(root), root_id_(tree.find(root)) {
    for (int i = 0; i < kNames; ++i) {
      ordered_[place(i)] = "ordered" + std::to_string(i);
      unordered_[place(i)] = "unordered" + std::to_string(i);
    }
  }

  Result step(std::mt19937& random) {
    const unsigned dice = random() % 100;
    const int name = static_cast<int>(random() % kNames);
    if (dice < 20) return read(name, random() % 2 ? Op::latest : Op::latest_xact);
    if (dice < 30) return write(name, nullptr);
    if (dice < 45) return remove(name);
    if (dice < 65) return read_and_write(name, static_cast<int>(random() % kNames), random);
    if (dice < 75) return move();
    if (dice < 85) return read_mover(random() % 6);
    return step_unordered(name, random() % 3);
  }

 private:
  static constexpr int kParent = 1000;  // the number of the mover's first parent

  static std::size_t place(int i) { return static_cast<std::size_t>(i); }

  // A name's last write, and whether that was no removal, in one word.
  struct State {
    Stamp word = 0;
    State() = default;
    State(Stamp stamp, bool exists) : word(2 * stamp + exists) {}
    [[nodiscard]] Stamp stamp() const { return word / 2; }
    [[nodiscard]] bool exists() const { return word % 2 != 0; }
    bool operator==(const State&) const = default;
  };
  // begun != done while a write is in progress.
  struct Life {
    std::mutex mutex;
    std::atomic<State> begun{}, done{};
  };

  std::optional<Code> commit(const std::string& parent, const std::string& child, Stamp stamp,
                             const Pose& pose, bool is_static = false,
                             const std::vector<std::string>* read_names = nullptr,
                             const std::vector<Version>* read_versions = nullptr) {
    const std::array<std::string_view, 2> names{parent, child};
    const std::array<Row, 1> rows{Row{0, 1, stamp, pose}};
    CommitRequest request{.names = names, .rows = rows, .is_static = is_static};
    std::vector<std::string_view> reads;
    if (read_names) {
      reads.assign(read_names->begin(), read_names->end());
      request.read_names = reads;
      request.read_versions = *read_versions;
    }
    std::uint8_t stored;
    try {
      tree_.commit(request, {&stored, 1});
    } catch (const Rejected& rejected) {
      return rejected.code;
    }
    return {};
  }
  std::optional<Code> remove_frame(const std::string& name) {
    try {
      tree_.remove_frame(name, true);
    } catch (const Rejected& rejected) {
      return rejected.code;
    }
    return {};
  }
  static Pose pose_of(Stamp stamp, int number) {
    return {static_cast<double>(stamp), static_cast<double>(number), 0, 0, 0, 0, 1};
  }

  // Calls look_up() with Refs of the names until they are current after it.
  template <class LookUp>
  void look_up(std::initializer_list<const std::string*> names, LookUp&& look_up) const {
    for (;;) {
      std::vector<Tree::FrameRef> refs;
      for (const std::string* name : names) refs.push_back(tree_.find_ref(*name));
      look_up(refs);
      if (std::all_of(refs.begin(), refs.end(), [&](auto ref) { return tree_.is_current(ref); }))
        return;
    }
  }

  // Notes what was read of an ordered name. `before` is its state before the lookup, if no write
  // was in progress then.
  void note(int name, const std::optional<State>& before, const Answer& answer, Result& result) {
    if (answer.failure.code == Code::ok) {
      result.is_nonsense |= answer.pose.y != name + 1 || answer.pose.x != answer.stamp;
      return result.accesses.push_back({false, name, static_cast<Stamp>(answer.pose.x)});
    }
    if (!before || lives_[place(name)].begun.load() != *before) return;  // either may be right
    if (before->exists())
      result.is_nonsense = true;  // it has existed all the time
    else
      result.accesses.push_back({false, name, before->stamp()});
  }
  std::optional<State> settled(int name) {
    Life& life = lives_[place(name)];
    const State done = life.done.load();
    return life.begun.load() == done ? std::optional(done) : std::nullopt;
  }

  Result read(int name, Op op) {
    Result result;
    const auto before = settled(name);
    Answer answer;
    look_up({&ordered_[place(name)]},
            [&](const auto& refs) { tree_.lookup({op, root_id_, refs[0].id}, answer); });
    note(name, before, answer, result);
    return result;
  }

  // Runs write() as the next write of a name.
  template <class Write>
  Result in_order(int name, bool exists_then, Result result, Write&& write) {
    Life& life = lives_[place(name)];
    const std::lock_guard lock(life.mutex);
    const State before = life.done.load(), next{clock_.fetch_add(1) + 1, exists_then};
    life.begun = next;
    result.rejected = write(next.stamp());
    result.accesses.push_back({true, name, next.stamp()});
    if (result.rejected)
      life.begun = before;
    else
      life.done = next;
    return result;
  }
  Result write(int name, Result* read, const std::vector<std::string>* read_names = nullptr,
               const std::vector<Version>* read_versions = nullptr) {
    return in_order(name, true, read ? *read : Result(), [&](Stamp stamp) {
      return commit(root_, ordered_[place(name)], stamp, pose_of(stamp, name + 1), false,
                    read_names, read_versions);
    });
  }
  Result remove(int name) {
    return in_order(name, false, {}, [&](Stamp) { return remove_frame(ordered_[place(name)]); });
  }

  // A transaction that reads two names and writes one of them.
  Result read_and_write(int name, int other, std::mt19937& random) {
    Result result;
    const std::array<int, 2> read{name, other};
    const std::optional<State> before[] = {settled(name), settled(other)};
    std::array<Answer, 2> answers;
    std::vector<std::string> names;
    std::vector<Version> versions;
    for (bool again = true; again;) {
      names.clear(), versions.clear();
      std::array<Tree::FrameRef, 2> refs;
      std::array<Query, 2> queries;
      for (std::size_t i = 0; i < 2; ++i) {
        refs[i] = tree_.find_ref(ordered_[place(read[i])]);
        queries[i] = {Op::latest_xact, root_id_, refs[i].id};
      }
      ReadSet reads;
      tree_.lookup_transaction(queries, answers, reads);
      again = false;
      for (std::size_t i = 0; i < 2; ++i) {
        const std::string& text = ordered_[place(read[i])];
        again |= tree_.find_ref(text) != refs[i];
        if (refs[i].id == 0) names.push_back(text), versions.push_back(0);
      }
      for (const ReadVersion& each : reads)
        names.push_back(tree_.name(each.frame)), versions.push_back(each.version);
    }
    for (std::size_t i = 0; i < 2; ++i) note(read[i], before[i], answers[i], result);
    // That a name does not exist is as true after it came and went: the commit does not conflict.
    std::erase_if(result.accesses, [&](const Access& access) {
      return answers[access.name == name ? 0 : 1].failure.code != Code::ok;
    });
    if (random() % 2 == 0) std::this_thread::yield();
    return result.is_nonsense ? result : write(name, &result, &names, &versions);
  }

  // Puts the mover under a new parent and back under the root, and removes the parent.
  Result move() {
    const std::unique_lock lock(moving_, std::try_to_lock);
    if (!lock) return {};
    const int number = kParent + ++parents_;
    const std::string parent = "parent" + std::to_string(number);
    const Stamp stamp = 10 * parents_;
    const Pose under_parent{0, 0, static_cast<double>(number), 0, 0, 0, 1};
    if (commit(root_, parent, 1, pose_of(0, number), true)) return {.rejected = Code::limit};
    if (!commit(parent, "mover", stamp, under_parent)) {
      commit(parent, "mover", stamp + 3, under_parent);
      moved_ = stamp;
      commit(root_, "mover", stamp + 5, {});
    }
    remove_frame(parent);
    return {};
  }
  // If the mover has a pose at a past time, then by the parent that it had.
  Result read_mover(Stamp moves_ago) {
    Answer answer;
    look_up({&mover_}, [&](const auto& refs) {
      tree_.lookup({Op::at, root_id_, refs[0].id, moved_ - 10 * moves_ago + 1}, answer);
    });
    return {.is_nonsense = answer.failure.code == Code::ok && answer.pose.y != answer.pose.z};
  }

  Result step_unordered(int name, unsigned what) {
    const std::string& text = unordered_[place(name)];
    const int number = kNames + name + 1;
    if (what == 0) {
      const Stamp stamp = clock_.fetch_add(1) + 1;
      return {.rejected = commit(root_, text, stamp, pose_of(stamp, number))};
    }
    if (what == 1) return {.rejected = remove_frame(text)};
    Answer answer;
    look_up({&text}, [&](const auto& refs) {
      tree_.lookup({Op::latest_xact, root_id_, refs[0].id}, answer);
    });
    return {.is_nonsense = answer.failure.code == Code::ok && answer.pose.y != number};
  }

  Tree& tree_;
  const std::string root_, mover_ = "mover";
  const FrameId root_id_;
  std::array<std::string, kNames> ordered_, unordered_;
  std::array<Life, kNames> lives_;
  std::atomic<Stamp> clock_{0}, moved_{0};
  std::mutex moving_;
  int parents_ = 0;  // guarded by moving_
};

}  // namespace ztf
