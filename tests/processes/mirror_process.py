"""A mirror in a process of its own: ``python -m tests.processes.mirror_process ENDPOINT``.

Each line on stdin is answered with a line of JSON: where the mirror is, and what it has. It may be
stopped (SIGSTOP); a further argument slows it down, in seconds per message. With ``pair A B``, it
is one of this pair of frames.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

from zenoh_tf import TransformException
from zenoh_tf.mirrors.mirroring import Mirroring
from zenoh_tf_client import Mirror, TransformClient

from .line_process import LineProcess


class MirrorProcess(LineProcess):
    """A running one."""

    def __init__(self, endpoint: str, *arguments: str) -> None:
        super().__init__("-m", "tests.processes.mirror_process", endpoint, *arguments)

    def state(self) -> dict[str, Any]:
        """Where it is: `seq`, `instance`, `age_s`, `synced`, `snapshots` and `versions`."""
        found: dict[str, Any] = json.loads(self.ask())
        return found


def versions(mirror: Mirror) -> dict[str, int]:
    """The version of every frame."""
    found = {}
    for name in mirror.frames():
        try:
            found[name] = mirror.frame(name).version
        except TransformException:  # removed meanwhile
            continue
    return found


def main() -> None:
    pairs: list[tuple[str, str]] | None = None
    if sys.argv[2:3] == ["pair"]:
        pairs = [(sys.argv[3], sys.argv[4])]
    elif len(sys.argv) > 2:
        slow_down(float(sys.argv[2]))
    delay_s = None if pairs is None else 0.0
    with (
        TransformClient.connect(sys.argv[1], timeout_s=20) as tf,
        tf.mirror(pairs, max_delay_s=delay_s) as mirror,
    ):
        while True:
            state = {
                "seq": mirror.seq,
                "instance": mirror.instance,
                "age_s": mirror.age_s,
                "synced": mirror.synced,
                "snapshots": mirror._feed.snapshots,
                "versions": versions(mirror),
            }
            print(json.dumps(state), flush=True)
            if not sys.stdin.readline():
                return


def slow_down(pause_s: float) -> None:
    """Let each message take this much longer."""
    received = Mirroring.received

    def slowly(self: Mirroring, data: bytes, sender: str | None = None) -> None:
        time.sleep(pause_s)
        received(self, data, sender)

    Mirroring.received = slowly  # type: ignore[method-assign]


if __name__ == "__main__":
    main()
