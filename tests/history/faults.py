"""Faults that the checker must find: one exact replacement in a copy of the core each."""

from __future__ import annotations

from typing import NamedTuple

from .history import Concurrency

#: As many histories as a fault may take to show.
HISTORIES = 12

EVERYWHERE: tuple[Concurrency, ...] = ("optimistic", "2pl", "giant")


class Fault(NamedTuple):
    name: str
    modes: tuple[Concurrency, ...]  # in which it must be found
    file: str
    old: str
    new: str


FAULTS = [
    Fault(
        "a lookup is not validated",
        ("optimistic",),
        "guards.hpp",
        "if (step.frame->version.load() != step.version) return false;",
        "(void)step.frame->version.load();",
    ),
    Fault(
        "lookups together are not validated",
        ("optimistic",),
        "guards.hpp",
        "if (frames_[read.frame].version.load() != read.version) return false;",
        "if (frames_[read.frame].version.load() < read.version) return false;",
    ),
    Fault(
        "a lookup does not wait for the writer of a frame",
        ("optimistic",),
        "lock_words.hpp",
        "return version & kWriting ? wait_for_writer() : version;",
        "return version;",
    ),
    Fault(
        "a commit leaves the version as it was",
        ("optimistic",),
        "lock_words.hpp",
        "word_.store(before + kIncrement, std::memory_order_release);",
        "word_.store(before, std::memory_order_release);",
    ),
    Fault(
        "write locks are released before the last write",
        ("optimistic", "2pl"),
        "tree_write.cpp",
        """    write(locks);
    count_authority();  // before the release: after it a set took 5 % longer
    locks.release(changed_);
""",
        """    locks.begin_write();
    names_.publish(children_);
    for (std::size_t i = 0; i + 1 < groups_.size(); ++i) (void)apply(groups_[i]);
    locks.release(children_);
    (void)apply(groups_.back());
    count_authority();
""",
    ),
    Fault(
        "shared words are released before writing",
        ("2pl",),
        "write_locks.hpp",
        "      pause(attempt);\n    }\n",
        "      pause(attempt);\n    }\n"
        "    for (const FrameId id : ids) tree_.frames_[id].shared.unlock();\n",
    ),
    Fault(
        "a reader drops its shared locks early",
        ("2pl",),
        "guards.hpp",
        "          held_.push_back(id);\n",
        "          frames_[id].shared.unlock_shared();\n",
    ),
    Fault(
        "a reader takes no mutex",
        ("giant",),
        "tree_read.hpp",
        "const std::lock_guard lock(giant_);",
        "",
    ),
    Fault(
        "readers are not held off",
        ("optimistic",),
        "tree_write.cpp",
        "    locks.begin_write();\n    names_.publish(children_);\n",
        "    names_.publish(children_);\n",
    ),
    Fault(
        "a commit that has read others holds readers off late",
        ("optimistic",),
        "tree_write.cpp",
        "    if (!request_.read_names.empty()) locks.begin_write();\n",
        "",
    ),
    Fault(
        "rows are committed one by one",
        EVERYWHERE,
        "tree_write.cpp",
        "  Commit commit(*this, request, stored);\n",
        """  if (request.rows.size() > 1) {
    for (std::size_t i = 0; i < request.rows.size(); ++i) {
      CommitRequest one = request;
      one.rows = request.rows.subspan(i, 1);
      if (i > 0) one.read_names = {};
      this->commit(one, stored.subspan(i, 1));
    }
    return;
  }
  Commit commit(*this, request, stored);
""",
    ),
    Fault(
        "the last row of a commit is lost",
        EVERYWHERE,
        "tree_write.cpp",
        "for (FrameWrites& group : groups_)\n      if (group.is_append",
        "for (FrameWrites& group : groups_)\n"
        "      if (&group == &groups_.back() && groups_.size() == 3) break; else if (group.is_append",
    ),
    Fault(
        "what was read is not checked at the commit",
        EVERYWHERE,
        "tree_write.cpp",
        "if (!validate_read_set(locks)) reject_conflict(request_.read_names[conflict_]);",
        "if (!validate_read_set(locks) && request_.rows.empty()) reject_conflict({});",
    ),
    Fault(
        "what was read is checked only where it is written, too",
        EVERYWHERE,
        "tree_write.cpp",
        "own ? *own != read : id ? tree_.frames_[id].version.load() != read : read != 0",
        "own ? *own != read : id == 0 && read != 0",
    ),
    Fault(
        "what was read is checked before the locks are held",
        EVERYWHERE[:2],
        "tree_write.cpp",
        "    WriteLocks locks(tree_, children_);\n",
        """    if (!validate_read_set(WriteLocks(tree_, FrameList()))) reject_conflict({});
    const_cast<CommitRequest&>(request_).read_names = {};
    WriteLocks locks(tree_, children_);
""",
    ),
    Fault(
        "a reader whose optimistic attempts failed reads on without locks",
        ("optimistic",),
        "tree_read.hpp",
        """      for (int i = 0; i < kOptimisticAttempts; ++i) {
        OptimisticGuard guard(frames_, reads);
        if (attempt(guard)) return;
        count_retry();
      }
      SmallVector<FrameId, 64> wanted;
""",
        """      SmallVector<FrameId, 64> wanted;
      {
        LockingGuard guard(frames_, reads, wanted);
        attempt(guard);
        return;
      }
""",
    ),
    Fault(
        "a lookup gives its last answer again",
        EVERYWHERE,
        "tree_read.cpp",
        "ZTF_MULTIVERSION void Tree::lookup(const Query& query, Answer& answer) const {\n",
        """ZTF_MULTIVERSION void Tree::lookup(const Query& query, Answer& answer) const {
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
    if (!memory.used) lookup(query, memory.answer);
    remembers = true;
    answer = memory.answer;
    return;
  }
""",
    ),
    Fault(
        "late rows are let in behind newer ones",
        EVERYWHERE,
        "history.hpp",
        "return stamp < newest && span_ns(stamp, newest) > cache_ns;",
        "return stamp < newest && span_ns(stamp, newest) > cache_ns + 64;",
    ),
]

#: No faults. Two of them force slow paths that the histories hardly ever reach otherwise.
SOUND = [
    Fault("none", EVERYWHERE, "tree_read.hpp", "#pragma once\n", "#pragma once\n"),
    Fault(
        "readers always lock",
        ("optimistic",),
        "tree_read.hpp",
        "constexpr int kOptimisticAttempts = 64;",
        "constexpr int kOptimisticAttempts = 0;",
    ),
    Fault(
        "reads of a single frame always lock",
        EVERYWHERE,
        "lock_words.hpp",
        "static constexpr int kOptimisticReads = 64;",
        "static constexpr int kOptimisticReads = 0;",
    ),
]
