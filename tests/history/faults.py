"""Faults that the checker must find: one exact replacement in a copy of the core each."""

from __future__ import annotations

from typing import NamedTuple

from .history import Concurrency, Reads

#: As many histories as a sound core must pass.
HISTORIES = 12
#: As many as a fault may take to show. The first one ends the search. On a machine with a load of
#: 40, two faults took from 2 to more than 12.
FAULTY_HISTORIES = 60

EVERYWHERE: tuple[Concurrency, ...] = ("optimistic", "2pl", "giant")


class Fault(NamedTuple):
    name: str
    modes: tuple[Concurrency, ...]  # in which it must be found
    file: str
    old: str
    new: str
    reads: Reads = "tree"  # how half of the threads must read for it to be found


FAULTS = [
    Fault(
        "a lookup is not validated",
        ("optimistic",),
        "reads/guards.hpp",
        "if (step.frame->version.current() != step.version) return false;",
        "(void)step.frame->version.current();",
    ),
    Fault(
        "lookups together are not validated",
        ("optimistic",),
        "reads/guards.hpp",
        "if (frames_[read.frame].version.current() != read.version) return false;",
        "if (frames_[read.frame].version.current() < read.version) return false;",
    ),
    Fault(
        "a lookup does not wait for the writer of a frame",
        ("optimistic",),
        "records/lock_words.hpp",
        "return version & kWriting ? wait_for_writer() : version;",
        "return version;",
    ),
    Fault(
        "a commit leaves the version as it was",
        ("optimistic",),
        "records/versions.hpp",
        "return before + kVersionStep;",
        "return before;",
    ),
    Fault(
        "write locks are released before the writes",
        ("optimistic", "2pl"),
        "commits/commit.cpp",
        """  execution.apply();
  locks.release(execution.frames_with_new_version(locks));
""",
        """  locks.release(locks.frames());
  execution.apply();
""",
    ),
    Fault(
        "shared words are released before writing",
        ("2pl",),
        "modes/two_phase.hpp",
        "      pause(attempt);\n    }\n",
        "      pause(attempt);\n    }\n"
        "    for (const FrameId id : ids) tree.frames[id].shared.unlock();\n",
    ),
    Fault(
        "a reader drops its shared locks early",
        ("2pl",),
        "modes/two_phase.hpp",
        "          held_.push_back(id);\n",
        "          frames_[id].shared.unlock_shared();\n",
    ),
    Fault(
        "a reader takes no mutex",
        ("giant",),
        "modes/giant.hpp",
        "    const auto lock = Giant::lock(tree);\n",
        "",
    ),
    Fault(
        "readers are not held off",
        ("optimistic",),
        "commits/commit.cpp",
        "  locks.begin_write();\n  ticket.draw();\n  execution.apply();\n",
        "  ticket.draw();\n  execution.apply();\n",
    ),
    Fault(
        "a commit that has read others holds readers off late",
        ("optimistic",),
        "commits/commit.cpp",
        "    locks.begin_write();\n    ticket.draw();\n    plan.validate_read_set(locks);\n",
        "    ticket.draw();\n    plan.validate_read_set(locks);\n",
    ),
    Fault(
        "rows are committed one by one",
        EVERYWHERE,
        "commits/commit.cpp",
        "  CommitPlan plan(tree, request, stored);\n",
        """  if (request.rows.size() > 1) {
    for (std::size_t i = 0; i < request.rows.size(); ++i) {
      CommitRequest one = request;
      one.rows = request.rows.subspan(i, 1);
      if (i > 0) one.read_names = {};
      commit(tree, one, stored.subspan(i, 1));
    }
    return;
  }
  CommitPlan plan(tree, request, stored);
""",
    ),
    Fault(
        "the last row of a commit is lost",
        EVERYWHERE,
        "commits/apply.cpp",
        "    if (apply_group(group)) changed_.push_back(group.child);\n",
        "    if (&group == &plan_.groups().back() && plan_.groups().size() == 3) break;\n"
        "    else if (apply_group(group)) changed_.push_back(group.child);\n",
    ),
    Fault(
        "what was read is not checked at the commit",
        EVERYWHERE,
        "commits/commit.cpp",
        "    plan.validate_read_set(locks);\n",
        "    if (plan.groups().empty()) plan.validate_read_set(locks);\n",
    ),
    Fault(
        "what was read is checked only where it is written, too",
        EVERYWHERE,
        "commits/plan.cpp",
        "locked ? *locked : id ? tree_.frames[id].version.current() : 0;",
        "locked ? *locked : id ? request_.read_versions[i] : 0;",
    ),
    Fault(
        "what was read is checked before the locks are held",
        EVERYWHERE[:2],
        "commits/commit.cpp",
        "  FrameList all;\n",
        """  FrameList all;
  plan.validate_read_set(WriteLocks(tree, all));
  const_cast<CommitRequest&>(plan.request()).read_names = {};
""",
    ),
    Fault(
        "a reader whose optimistic attempts failed reads on without locks",
        ("optimistic",),
        "modes/optimistic.hpp",
        """    const bool is_read = retry(kAttempts, [&] {
      OptimisticGuard guard(tree.frames, reads);
      return attempt(guard);
    });
    if (is_read) return;
    SmallVector<FrameId, 64> wanted;
""",
        """    SmallVector<FrameId, 64> wanted;
    {
      LockingGuard guard(tree.frames, reads, wanted);
      attempt(guard);
      return;
    }
""",
    ),
    Fault(
        "a lookup gives its last answer again",
        EVERYWHERE,
        "lookups/lookup.cpp",
        "void lookup(const TreeState& tree, const Query& query, Answer& answer) {\n",
        """void lookup(const TreeState& tree, const Query& query, Answer& answer) {
  struct Memory {
    Answer answer;
    bool used = true;
  };
  thread_local Memory memories[kOps][64][64];
  thread_local bool remembers = true;
  if (remembers) {
    Memory& memory = memories[static_cast<int>(query.op)][query.target][query.source];
    memory.used = !memory.used;
    remembers = false;
    if (!memory.used) lookup(tree, query, memory.answer);
    remembers = true;
    answer = memory.answer;
    return;
  }
""",
    ),
    Fault(
        "late rows are let in behind newer ones",
        EVERYWHERE,
        "histories/history.hpp",
        "return stamp < newest && span_ns(stamp, newest) > cache_ns;",
        "return stamp < newest && span_ns(stamp, newest) > cache_ns + 64;",
    ),
    Fault(
        "a lookup does not see that an id has passed on",
        ("optimistic", "giant"),
        "names/reader.hpp",
        "std::memory_order_acquire) / NameEntry::kIncrement ==\n           ref.generation;",
        "std::memory_order_acquire) != ref.generation + 7u;",
    ),
    Fault(
        "past links lead to the next owner of an id",
        EVERYWHERE,
        "histories/insert.hpp",
        "if (is_lost(ring.parent(first + i))) ring.store_parent(first + i, 0);",
        "",
    ),
    Fault(
        "a commit's number is drawn before its locks",
        EVERYWHERE[:2],
        "commits/commit.cpp",
        "  FrameList all;\n",
        "  ticket.draw();\n  FrameList all;\n",
        "mirror",
    ),
    Fault(
        "a commit's number is drawn after what was read is compared",
        EVERYWHERE[:2],
        "commits/commit.cpp",
        "    ticket.draw();\n    plan.validate_read_set(locks);\n",
        "    plan.validate_read_set(locks);\n",
        "mirror",
    ),
    Fault(
        "a mirror applies a message in two halves",
        EVERYWHERE,
        "replication/change_replay.cpp",
        "void ChangeReplay::apply(const ChangeColumns& changes, Seq last) {\n",
        """void ChangeReplay::apply(const ChangeColumns& changes, Seq last) {
  thread_local bool is_half = false;
  if (const std::size_t n = changes.kind.size() / 2; n > 0 && !is_half) {
    ChangeColumns half = changes;
    half.kind = half.kind.first(n);
    half.frame = half.frame.first(n);
    half.version = half.version.first(n);
    is_half = true;
    apply(half, last);
    is_half = false;
  }
""",
        "mirror",
    ),
    Fault(
        "a mirror says early that a commit is there",
        EVERYWHERE,
        "replication/change_replay.cpp",
        "    find_names(changes.names);\n",
        "    tree_.replayed.store(last, std::memory_order_release);\n"
        "    find_names(changes.names);\n",
        "mirror",
    ),
]

#: No faults. Two of them force slow paths that the histories hardly ever reach otherwise.
SOUND = [
    Fault("none", EVERYWHERE, "lookups/transaction.hpp", "#pragma once\n", "#pragma once\n"),
    Fault(
        "readers always lock",
        ("optimistic",),
        "modes/optimistic.hpp",
        "static constexpr int kAttempts = 64;",
        "static constexpr int kAttempts = 0;",
    ),
    Fault(
        "reads of a single frame always lock",
        EVERYWHERE,
        "records/lock_words.hpp",
        "static constexpr int kOptimisticReads = 64;",
        "static constexpr int kOptimisticReads = 0;",
    ),
]
