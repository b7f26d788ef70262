"""The mutations of the core: each one is one decision that is made otherwise.

`old` is in the file once. `tests` are the C++ tests of the decision's subject, in the order in
which they are asked. `survives` says of a known survivor why, or what else finds it.
"""

from __future__ import annotations

from dataclasses import dataclass

COMMIT = ("test_tree_commit", "test_tree_errors", "test_topology", "test_waiting")
WALK = ("test_tree_walk", "test_tree_errors", "test_topology", "test_concurrent_reads")
REPLAY = ("test_concurrent_change_log", "test_concurrent_interest_reader")


@dataclass(frozen=True)
class Mutant:
    file: str
    what: str
    old: str
    new: str
    tests: tuple[str, ...]
    survives: str = ""


def plan(what: str, old: str, new: str, survives: str = "") -> Mutant:
    return Mutant("commits/plan.cpp", what, old, new, COMMIT, survives)


def topology(what: str, old: str, new: str, survives: str = "") -> Mutant:
    tests = ("test_topology", "test_tree_errors", "test_concurrent_topology")
    return Mutant("commits/topology.cpp", what, old, new, tests, survives)


def execution(what: str, old: str, new: str, survives: str = "") -> Mutant:
    return Mutant("commits/apply.cpp", what, old, new, COMMIT, survives)


def time_jump(what: str, old: str, new: str, survives: str = "") -> Mutant:
    return Mutant("commits/time_jumps.cpp", what, old, new, COMMIT, survives)


def walk(what: str, old: str, new: str, survives: str = "") -> Mutant:
    return Mutant("reads/walk.hpp", what, old, new, WALK, survives)


def replay(what: str, old: str, new: str, survives: str = "") -> Mutant:
    return Mutant("replication/change_replay.cpp", what, old, new, REPLAY, survives)


MUTANTS = (
    topology("a cycle may close", "if (at == group.child) return", "if (false) return"),
    topology("one link too deep is allowed", "if (depth > limit)", "if (depth > limit + 1)"),
    topology(
        "a walk leaves the links of its commit",
        "if (planned && planned->is_linked)",
        "if (planned == &group)",
    ),
    topology(
        "a walk never leaves the links of its commit",
        "return !each.is_linked || tree_.removed(each.child);",
        "return true;",
    ),
    topology(
        "the last frame is named as too deep",
        "|| result == worst) continue;",
        ") continue;",
    ),
    plan(
        "a changed read set passes",
        "if (now != request_.read_versions[i]) reject_conflict",
        "if (now < request_.read_versions[i]) reject_conflict",
    ),
    plan(
        "a sample at the newest stamp is appended",
        "newest < write.stamp &&",
        "newest <= write.stamp &&",
    ),
    plan("another parent is appended", "frame.parent.load(relaxed) == write.parent &&", "true &&"),
    plan(
        "another authority is appended",
        "frame.authority.load(relaxed) == names_.authority();",
        "true;",
    ),
    time_jump(
        "a first late sample restarts",
        "if (events.run_commits.load(kRelaxed) < 2) return false;",
        "",
    ),
    plan(
        "the rows of a stamp in any order",
        "return a.stamp != b.stamp ? a.stamp < b.stamp : a.row < b.row;",
        "return a.stamp != b.stamp ? a.stamp < b.stamp : a.row > b.row;",
    ),
    plan(
        "late rows are never too old",
        "if (has_samples && too_old(write.stamp, newest, limits_.cache_ns)) return",
        "if (has_samples && newest < 0 && newest > 0) return",
    ),
    plan(
        "a row as old as a full frame's oldest has no room",
        "return write.stamp < oldest_of_full ?",
        "return write.stamp <= oldest_of_full ?",
    ),
    plan(
        "a reparenting is never the first",
        "is_first_reparenting_ |= !tree_.ever_reparented.load();",
        "",
    ),
    plan("rewriting wakes only by stamp", "(has_samples && write.stamp <= newest)", "false"),
    plan(
        "a frame may have two authorities",
        "if (parent_before != 0 && tree_.options.one_authority_per_frame &&",
        "if (parent_before != 0 && parent_before == group.child &&",
    ),
    plan(
        "a new static link changes no newest parent",
        "if (!has_samples || request_.is_static || write.stamp >= newest) {",
        "if (!has_samples || write.stamp >= newest) {",
    ),
    execution("a restart keeps the samples", "  drop_samples(*group.frame);\n", ""),
    execution(
        "a change of parent goes uncounted",
        "if (had_data && group.new_parent != 0) {",
        "if (had_data && group.new_parent == 1) {",
    ),
    execution(
        "a dropped row counts as stored",
        "      ++tally_.dropped;\n      continue;",
        "      ++tally_.stored;\n      continue;",
    ),
    execution(
        "a changed frame is not reported",
        "if (apply_group(group)) changed_.push_back(group.child);",
        "(void)apply_group(group);",
    ),
    execution(
        "a first link is a change",
        "const bool had_data = parent_before != 0;",
        "const bool had_data = true;",
    ),
    walk(
        "the depth limit is one less",
        "path.steps.size() == max_depth_",
        "path.steps.size() + 1 >= max_depth_",
    ),
    walk(
        "a path that is too deep ends at a root",
        "path.state = has_link ? State::too_deep : is_root",
        "path.state = is_root",
    ),
    walk(
        "a guard's retry is ignored",
        "if (!guard_.read_version(*frame, step->version)) return WalkResult::retry;",
        "(void)guard_.read_version(*frame, step->version);",
    ),
    walk(
        "the ends of both segments are exchanged",
        "is_source ? links : other_links, from_target,",
        "is_source ? other_links : links, from_target,",
    ),
    walk(
        "a near ancestor off by one",
        "return static_cast<std::ptrdiff_t>(i);",
        "return static_cast<std::ptrdiff_t>(i + 1);",
    ),
    walk(
        "a far ancestor is any visit",
        "frame < other.frame : links < other.links;",
        "frame < other.frame : links > other.links;",
    ),
    walk(
        "a far walk leaves the starts out",
        "for (std::size_t i = 0; i <= from_target.steps.size(); ++i) {",
        "for (std::size_t i = 1; i <= from_target.steps.size(); ++i) {",
    ),
    walk(
        "a far walk leaves the roots out",
        "for (std::size_t i = 0; i <= from_source.steps.size(); ++i)",
        "for (std::size_t i = 0; i < from_source.steps.size(); ++i)",
    ),
    replay(
        "a change is applied twice",
        "if (changes.version[i] > target.before)",
        "if (changes.version[i] >= target.before)",
        "a sample of a known stamp takes its own place, and each other kind leaves what it left: "
        "the rule spares work, and the concurrent tests find its lack only now and then",
    ),
    replay(
        "new names are seen before their frames",
        "id = table.insert_removed(name);",
        "id = table.insert(name);",
    ),
    replay(
        "an unchanged frame gets a version",
        "if (target.after == 0) return before;",
        "",
    ),
    replay(
        "an orphan keeps its past parents",
        "if (changes.lost[row] != kNoParent) history.forget_parent(ids_[changes.lost[row]]);",
        "",
    ),
    replay(
        "a removed frame keeps its samples",
        "      case ChangeKind::removed:\n        history.clear();",
        "        history.clear();\n        break;\n      case ChangeKind::removed:",
    ),
    replay("a removed frame stays live", "      target.is_live = false;\n", ""),
    replay(
        "the replay's number comes late",
        "tree_.replayed.store(last, std::memory_order_release);",
        "tree_.replayed.store(last - 1, std::memory_order_release);",
    ),
)
