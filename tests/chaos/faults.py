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
    file: str
    old: str
    new: str


FAULTS = [
    Fault(
        "an expiry is ignored",
        "service.py",
        "            if write.expires_ns < now_ns:\n",
        "            if False:\n",
    ),
    Fault(
        "an outcome is forgotten early",
        "reply_cache.py",
        "self._entries[request_id] = _Entry(until_ns)",
        "self._entries[request_id] = _Entry(now_ns)",
    ),
    Fault(
        "a commit is answered before it is applied",
        "service.py",
        "        return wire.commit_reply(self.commit(commit))\n",
        "        import threading, numpy\n"
        "        threading.Timer(0.002, self.commit, [commit]).start()\n"
        "        return wire.commit_reply(numpy.ones(commit.rows, numpy.uint8))\n",
    ),
]


def faulty_text(fault: Fault) -> str:
    """The file of a fault with its text replaced. Fails if the text is gone."""
    text = (SERVER / fault.file).read_text()
    found = text.count(fault.old)
    assert found == 1, f"{fault.name}: {fault.file} has the text {found} times"
    return text.replace(fault.old, fault.new)


def faulty_server(fault: Fault, folder: Path) -> list[str]:
    """Make a copy of the server with a fault, and return the command that runs it."""
    copy = folder / SERVER.name
    shutil.copytree(SERVER, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / fault.file).write_text(faulty_text(fault))
    return [sys.executable, "-c", _LAUNCH.format(folder=str(folder))]
