"""Faults that chaos must find: one exact replacement in a copy of the server each."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
SERVER = ROOT / "server/zenoh_tf_server"

#: Runs the server of a copy. The installed packages would be preferred to those of a folder.
_LAUNCH = """
import sys
from importlib.machinery import PathFinder

class Copy:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] == "zenoh_tf_server":
            return PathFinder.find_spec(name, path or [{folder!r}])

sys.meta_path.insert(0, Copy)
from zenoh_tf_server.main import main
sys.exit(main())
"""


class Fault(NamedTuple):
    name: str
    old: str  # occurs once in the server
    new: str
    #: The faults of chaos under which it shows, by their methods in run.py; empty: all of them.
    under: tuple[str, ...] = ()


FAULTS = [
    Fault(
        "an expiry is ignored",
        "wire.parse_write(message)",
        "(lambda write: (setattr(write, 'expires_ns', write.expires_ns and write.expires_ns"
        " + 60 * 10**9), write)[1])(wire.parse_write(message))",
        # Among all faults of chaos it took 9 to more than 12 runs.
        ("_stop_server", "_hold_network"),
    ),
    Fault(
        "an outcome is forgotten early",
        "self._entries[write.id] = _Entry(",
        "self._entries[write.id] = (lambda *a: _Entry(*(1 if each is expires_ns else each"
        " for each in a)))(",
    ),
    Fault(
        "a commit is answered before it is applied",
        "stored = commit.apply(self.tree)",
        "stored = (__import__('threading').Timer(0.002, commit.apply, (self.tree,)).start(),"
        " b'\\1' * len(commit.rows))[1]",
    ),
    Fault(
        "a lease outlives its server", "self._keeper = LeaseKeeper(tree)", "tree._begin_lease(60.0)"
    ),
    Fault(
        "a snapshot has a number of its future",
        "wire.SnapshotPlan(seq, ever_",
        "wire.SnapshotPlan(seq + 20, ever_",
    ),
    Fault(
        "the stream leaves commits out",
        "self._clock_ns, changes)",
        "self._clock_ns, changes if last % 20 else None)",
    ),
    Fault(
        "a replica shows less than its client has written",
        "if not instance or state.has(instance, seq):",
        "if seq >= 0:",
        ("_delay_replica",),
    ),
]


def faulty_text(fault: Fault) -> tuple[str, str]:
    """The file of a fault, and its content with the text replaced. Fails if the text is gone."""
    files = [(path, path.read_text()) for path in SERVER.rglob("*.py")]
    found = [(path, text) for path, text in files for _ in range(text.count(fault.old))]
    assert len(found) == 1, f"{fault.name}: the server has the text {len(found)} times"
    path, text = found[0]
    return str(path.relative_to(SERVER)), text.replace(fault.old, fault.new)


def faulty_server(fault: Fault, folder: Path) -> list[str]:
    """Make a copy of the server with a fault, and return the command that runs it."""
    copy = folder / SERVER.name
    shutil.copytree(SERVER, copy, ignore=shutil.ignore_patterns("__pycache__"))
    file, text = faulty_text(fault)
    (copy / file).write_text(text)
    return [sys.executable, "-c", _LAUNCH.format(folder=str(folder))]
