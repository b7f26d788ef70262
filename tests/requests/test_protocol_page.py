"""The examples that are written from docs/reference/protocol.md alone, against real servers.

Where they are wrong, the page is, or says too little. They import nothing of this project, so what
they and the server agree on is on the page.
"""

from __future__ import annotations

import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf_client import TransformClient

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
sys.path.insert(0, str(EXAMPLES))

from protocol_client import Client, TfError  # noqa: E402
from protocol_mirror import Mirror  # noqa: E402

S = 1_000_000_000
AHEAD = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@contextmanager
def connected(endpoint: str) -> Iterator[Client]:
    client = Client(endpoint)
    try:
        yield client
    finally:
        client.close()


@pytest.fixture
def foreign(server: ServerProcess) -> Iterator[Client]:
    with connected(server.endpoint) as client:
        yield client


def test_they_import_nothing_of_this_project() -> None:
    code = (
        "import sys, protocol_mirror; "
        "print([name for name in sys.modules if name.startswith('zenoh_tf')])"
    )
    found = subprocess.check_output([sys.executable, "-c", code], cwd=EXAMPLES, timeout=150)
    assert found == b"[]\n"


def test_the_client(foreign: Client, client: TransformClient) -> None:
    assert foreign.server["limits"]["rows"] > 0
    assert foreign.set([("map", "base", 5 * S, AHEAD)], authority="page") == b"\1"
    assert client.frame("base").authority == "page"
    assert foreign.move("map", "base", (0.5, 0.0, 0.0)) == 1
    foreign.publish("lidar/1", [("base", "lidar", 5 * S, AHEAD)], "static")
    (found,) = foreign.lookup("map", "lidar", None, wait_s=10.0)
    assert found == (5 * S + 1, (2.5, *AHEAD[1:]))
    assert client.lookup_transform("map", "lidar").transform.translation[0] == 2.5
    assert client.frame("lidar").authority == "lidar/1"
    good, late, early = foreign.lookup("map", "lidar", 5 * S, 9 * S, 1)
    assert good == (5 * S, (2.0, *AHEAD[1:]))
    assert isinstance(late, TfError) and late.code == 9 and late.facts["frame"] == "base"
    assert isinstance(early, TfError) and early.code == 8
    batch = [["lookup", _without(foreign, "lidar")], ["info", {"what": "frames"}]]
    replies = foreign.ask("batch", {"operations": batch})["replies"]
    assert replies[0]["status"] == b"\2" and replies[1]["value"] == client.frames()
    with pytest.raises(TfError) as caught:
        foreign.set([("lidar", "map", 5 * S, AHEAD)])
    assert caught.value.code == 4


def _without(foreign: Client, frame: str) -> dict[str, object]:
    from protocol_client import lookup_body  # noqa: PLC0415

    return lookup_body("nowhere", frame, [None])


def test_transactions_conflict(foreign: Client, client: TransformClient) -> None:
    client.set_transform(StampedTransform("map", "base", S, Transform()))
    read = foreign.ask("info", {"what": "frame", "frame": "base"})["value"]
    stale = {"read_names": ["base"], "read_versions": read["version"].to_bytes(8, "little")}
    client.set_transform(StampedTransform("map", "base", 2 * S, Transform()))
    with pytest.raises(TfError) as caught:
        foreign.set([("map", "base", 3 * S, AHEAD)], **stale)
    assert caught.value.code == 10


def check(mirror: Mirror, client: TransformClient) -> None:
    """The mirror's copy has what the server says of each frame."""
    mirror.follow(mirror.client.hello()["seq"])
    assert sorted(mirror.frames) == sorted(client.frames())
    for name, frame in mirror.frames.items():
        known = client.frame(name)
        newest = frame.samples[frame.stamps[-1]] if frame.stamps else (None, ())
        wanted = known.version, known.authority, known.static, known.samples, known.parent
        assert (frame.version, frame.authority, frame.static, len(frame.stamps), newest[0]) == (
            wanted
        ), name
        if not frame.static and frame.stamps:
            span = known.oldest_stamp_ns, known.newest_stamp_ns
            assert (frame.stamps[0], frame.stamps[-1]) == span, name
            for stamp_ns in frame.stamps:
                parent, pose = frame.samples[stamp_ns]
                if parent is None or parent != known.parent:
                    continue
                found = client.lookup_transform(parent, name, stamp_ns)
                assert tuple(found.transform.translation) == pose[:3], (name, stamp_ns)


def change(client: TransformClient, rng: random.Random, begin_ns: int) -> None:
    """Some commit or removal: a few samples of few frames, some of one frame, in any order."""
    kind = rng.random()
    name = f"f{rng.randrange(5)}"
    if kind < 0.05 and name in client.frames():
        client.remove_frame(name, subtree=True)
        return
    if kind < 0.08:
        client.clear()
        return
    if kind < 0.2:
        link = StampedTransform(f"p{rng.randrange(2)}", name, 1, Transform((rng.random(), 0, 0)))
        client.set_transform(link, static=True, authority="fixed")
        return
    rows = [
        StampedTransform(
            f"p{rng.randrange(2)}" if rng.random() < 0.2 else "p0",
            name,
            begin_ns + rng.randrange(20 * S),
            Transform((rng.random(), 0, 0)),
        )
        for _ in range(rng.randrange(1, 5))
    ]
    with suppress(InvalidArgumentException):  # all refused, if one is older than the cache time
        client.set_transforms_xact(rows, authority=rng.choice(["", "a", "b"]))


@pytest.mark.parametrize("seed", [1, pytest.param(None, marks=pytest.mark.slow)])
def test_the_mirror(foreign: Client, client: TransformClient, seed: int | None) -> None:
    rng = random.Random(seed or random.randrange(1 << 32))
    for _ in range(20):
        change(client, rng, S)
    mirror = Mirror(foreign)
    check(mirror, client)
    for step in range(8 if seed else 60):
        for _ in range(rng.randrange(1, 10)):
            change(client, rng, step * 2 * S)
        if rng.random() < 0.3:  # messages are missed
            while not mirror._messages.empty():
                mirror._messages.get()
        check(mirror, client)
    assert mirror.loads == 1


@pytest.mark.slow
def test_long_replies_come_in_parts(foreign: Client, client: TransformClient) -> None:
    client.set_transform(StampedTransform("map", "base", S, Transform()))
    found = foreign.lookup("map", "base", *[S] * 60_000)
    assert found == [(S, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))] * 60_000


@pytest.mark.slow
def test_names_that_are_freed(start_server: StartServer) -> None:
    """A sample whose parent was removed has none any more, also once its name is used again."""
    server = start_server("--limit", "frames=8")
    with connected(server.endpoint) as foreign, server.connect() as client:
        for stamp_ns, parent in ((S, "old"), (2 * S, "new")):
            client.set_transform(StampedTransform(parent, "child", stamp_ns, Transform()))
        mirror = Mirror(foreign)
        client.remove_frame("old")
        for number in range(20):  # more names than there is room for
            client.set_transform(StampedTransform("new", f"n{number}", S, Transform()))
            client.remove_frame(f"n{number}")
        client.set_transform(StampedTransform("new", "old", S, Transform()))
        check(mirror, client)
        assert mirror.frames["child"].samples[S][0] is None
        assert mirror.frames["child"].samples[2 * S][0] == "new"


@pytest.mark.slow
def test_a_new_server(start_server: StartServer) -> None:
    endpoint = free_endpoint()
    server = start_server(endpoint=endpoint)
    with connected(endpoint) as foreign:
        with server.connect() as client:
            client.set_transform(StampedTransform("map", "before", S, Transform()))
            mirror = Mirror(foreign)
            check(mirror, client)
        server.kill()
        server = start_server(endpoint=endpoint)
        with server.connect() as client:
            client.set_transform(StampedTransform("map", "after", S, Transform()))
            deadline_s = time.monotonic() + 60
            while "after" not in mirror.frames:
                assert time.monotonic() < deadline_s
                with suppress(Empty):  # until Zenoh has connected again
                    mirror.follow(mirror.last + 1)
            assert mirror.loads == 2 and "before" not in mirror.frames
            check(mirror, client)
