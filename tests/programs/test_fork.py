"""A forked child of a process that has connected: clear errors, no hang, its own exit status."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.processes.servers import ServerProcess

#: A client reads the server's memory where it can.
READS = "shared" if sys.platform == "linux" else "query"
SCRIPT = """
import os, sys
from zenoh_tf import ServerUnavailable, StampedTransform, Transform
from zenoh_tf_client import TransformClient, tf2

link = StampedTransform("a", "b", 0, Transform())
if {connected}:
    tf = TransformClient.connect(sys.argv[1])
    assert tf.reads == {reads!r}
    sensor = tf.broadcaster("sensor")
    sensor.send_static(link)
    mirror = tf.mirror()
    tf2.connect(sys.argv[1])
    buffer = tf2.Buffer()
    buffer.wait_for_transform_async("a", "b", tf2.Time()).result(20)
child = os.fork()
if child == 0:
    try:
        {action}
        print("done", flush=True)
    except ServerUnavailable as error:
        print(error, flush=True)
    sys.exit(7)
_, status = os.waitpid(child, 0)
assert os.waitstatus_to_exitcode(status) == 7, status
if {connected}:
    assert tf.can_transform("a", "b", timeout_s=5)  # the parent continues
"""


def run_in_child(server: ServerProcess, action: str, *, connected: bool) -> str:
    """What a forked child prints; it must end with the status that it chose."""
    done = subprocess.run(
        [
            sys.executable,
            "-W",
            "ignore::DeprecationWarning",  # Python 3.12 warns of every fork beside threads
            "-c",
            SCRIPT.format(action=action, connected=connected, reads=READS),
            server.endpoint,
        ],
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.strip()


@pytest.mark.parametrize(
    "action",
    [
        "tf.frames()",
        "tf.can_transform('a', 'b')",
        "tf.set_transform(link)",
        "sensor.send(link)",
        "TransformClient.connect(sys.argv[1])",
        "mirror.lookup_transform('a', 'b')",
        "mirror.lookup_latest_transform('a', 'b')",
        "mirror.wait_for()",
        "tf.mirror()",
        "buffer.wait_for_transform_async('a', 'b', tf2.Time()).result(20)",
    ],
)
def test_calls_in_a_forked_child_say_what_to_do(server: ServerProcess, action: str) -> None:
    said = run_in_child(server, action, connected=True)
    assert "was forked from one that had connected" in said
    assert "spawn" in said


@pytest.mark.parametrize("action", ["pass", "sensor.close()", "mirror.close()", "tf.close()"])
def test_a_forked_child_may_close_and_ends(server: ServerProcess, action: str) -> None:
    assert run_in_child(server, action, connected=True) == "done"


def test_a_child_forked_before_the_first_connection_connects(server: ServerProcess) -> None:
    action = "TransformClient.connect(sys.argv[1]).frames()"
    assert run_in_child(server, action, connected=False) == "done"
