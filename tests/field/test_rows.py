"""Rows that no tree can store: each costs itself, and never the rest of its message.

Public reports, replayed through the ROS 2 bridge, by puts and by transactions.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from itertools import pairwise
from math import inf, nan

import pytest

from tests.processes.servers import ServerProcess
from tests.ros2.conftest import Peer, authorities, server, start_peer
from tests.support import command_line
from tests.support.raw import raw
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.admission import REASONS, refused
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.introspection.frame_info import AuthorityInfo
from zenoh_tf.ros2.cdr import encode_tf_message
from zenoh_tf.ros2.keys import TF_MESSAGE
from zenoh_tf_client import TransformClient
from zenoh_tf_server import flags
from zenoh_tf_server.federation.settings import FederationSettings

__all__ = ["server", "start_peer"]

FLAGS = ("--ros2", "--max-future-s", "600")
S = 1_000_000_000

Link = tuple[str, str, int, tuple[float, ...]]


def at(*translation: float) -> tuple[float, ...]:
    return (*translation, 0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def peer(server: ServerProcess) -> Iterator[Peer]:
    peer = Peer(server.endpoint)
    yield peer
    peer.kill()


@pytest.fixture
def tf(server: ServerProcess) -> Iterator[TransformClient]:
    with server.connect() as tf:
        tf.reset()
        yield tf


def wait_for_refusals(tf: TransformClient, sender: str, count: int) -> AuthorityInfo:
    """A sender's record once so many rows are refused, which is counted after the commit."""
    wait_until(lambda: (found := authorities(tf).get(sender)) and found.refused >= count)
    record: AuthorityInfo = authorities(tf)[sender]
    return record


def send(peer: Peer, topic: str, *links: Link) -> None:
    """Send links as one message of ROS 2, which has no name but its topic."""
    payload = encode_tf_message(TransformRows.of_tuples(links))
    peer.put(f"0/{topic}/{TF_MESSAGE.chunk}/{TF_MESSAGE.hash}", payload.hex())


@pytest.mark.parametrize(
    ("bad", "reason", "count", "order"),
    [
        ((nan,) * 7, "NaN", 50, (0, 1, 2)),
        ((0.0, 0.2, 0.0, 0.0, 0.0, 0.0, nan), "NaN", 20, (1, 2, 0)),
        ((0.0, inf, 0.0, 0.0, 0.0, 0.0, 1.0), "infinite", 7, (0, 1, 2)),
        ((0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0), "squared norm", 7, (1, 2, 0)),
    ],
    ids=["all", "rotation", "infinite", "zero quaternion"],
)
def test_one_wheel_is_nan(
    server: ServerProcess,
    tf: TransformClient,
    peer: Peer,
    bad: tuple[float, ...],
    reason: str,
    count: int,
    order: tuple[int, ...],
) -> None:
    """NVIDIA-ISAAC-ROS/isaac_ros_nvblox#16, moveit/moveit2#298, ros/robot_state_publisher#4."""
    topic = f"wheels{count}{order[0]}{len(reason)}/tf"
    begun_ns = time.time_ns()
    for i in range(count):
        stamp_ns = begun_ns + i * 20_000_000
        rows = [
            ("odom", "base_link", stamp_ns, at(0.01 * i, 0, 0)),
            ("base_link", "left_wheel", stamp_ns, bad),
            ("base_link", "arm_1", stamp_ns, at(0.2, 0, 0.3)),
        ]
        send(peer, topic, *(rows[n] for n in order))
    sender = f"ros2:0/{topic}"
    wait_until(lambda: (found := authorities(tf).get(sender)) and found.stored == 2 * count)
    record = wait_for_refusals(tf, sender, count)
    assert sorted(tf.frames()) == ["arm_1", "base_link", "odom"]
    pose = tf.lookup_transform("odom", "arm_1").transform
    assert pose.translation[0] == pytest.approx(0.2 + 0.01 * (count - 1))
    assert record.commits == record.refused == count
    key = "bad_rotation" if reason == "squared norm" else "not_finite"
    assert record.refused_by_reason == {key: count}
    assert record.last_refusal is not None
    assert "'left_wheel'" in record.last_refusal and reason in record.last_refusal
    done = command_line.run("--connect", server.endpoint, "doctor", "--for", "0")
    found = [line for line in done.stdout.splitlines() if sender in line]
    assert found and "TF106" in done.stdout and "left_wheel" in done.stdout
    assert server.log.count("left_wheel") <= 2 * 16  # not a line for each message


@pytest.mark.parametrize(
    "names",
    [
        [("world", "robot"), ("", "world"), ("robot", ""), ("robot", "robot::lidar")],
        [("", ""), ("m", "m::link::sensor"), ("m", "m"), ("root", "m"), ("/", "x")],
    ],
    ids=["gazebo", "other order"],
)
def test_names_are_empty(tf: TransformClient, peer: Peer, names: list[tuple[str, str]]) -> None:
    """gazebosim/ros_gz#848, #410, #172."""
    topic = f"pose{len(names)}/tf"
    stamp_ns = time.time_ns()
    send(peer, topic, *((*pair, stamp_ns, at(1, 0, 0)) for pair in names))
    good = [pair for pair in names if all(n.strip("/") for n in pair) and pair[0] != pair[1]]
    sender = f"ros2:0/{topic}"
    record = wait_for_refusals(tf, sender, len(names) - 2)
    assert record.stored == len(good) == 2
    assert record.refused == len(names) - 2
    assert {(tf.parent(child), child) for _, child in good} == set(good)
    assert record.last_refusal is not None and "empty frame id" in record.last_refusal
    assert tf.lookup_transform(good[0][0], good[1][1])


@pytest.mark.parametrize(
    ("link", "good", "bad", "reason"),
    [
        ("wagen", b"wagen\0", b"w\xe4gen\0", "bad_name"),  # Latin-1
        ("arm_7", b"arm_7\0", b"ar\0_7\0", "bad_name"),
        ("stamp", struct.pack("<I", 999_999_999), struct.pack("<I", 1_000_000_000), "bad_stamp"),
    ],
)
@pytest.mark.parametrize("topic", ["tf", "tf_static"])
def test_a_row_that_is_no_text_or_time_costs_itself(
    tf: TransformClient, peer: Peer, topic: str, link: str, good: bytes, bad: bytes, reason: str
) -> None:
    """Drivers that write a Latin-1 name, a zero, or a second of nanoseconds."""
    second = time.time_ns() // S - 1
    rows = [("odom", name, second * S, at(1, 0, 0)) for name in ("left", link, "right")]
    rows[1] = (*rows[1][:2], second * S + 999_999_999, rows[1][3])
    payload = encode_tf_message(TransformRows.of_tuples(rows))
    assert payload.count(good) == 1
    sent = payload.replace(good, bad)
    peer.put(f"0/{link}/{topic}/{TF_MESSAGE.chunk}/{TF_MESSAGE.hash}", sent.hex())
    record = wait_for_refusals(tf, f"ros2:0/{link}/{topic}", 1)
    assert record.refused_by_reason == {reason: 1} and record.stored == 2
    assert sorted(tf.frames()) == ["left", "odom", "right"]


def test_a_transaction_stays_whole_and_names_the_row(tf: TransformClient) -> None:
    rows = [StampedTransform("odom", f"part_{n}", S, Transform()) for n in range(5)]
    rows[3] = StampedTransform("part_3", "part_3", S, Transform())
    with pytest.raises(InvalidArgumentException, match=r"'part_3'.*\(index 3\)") as caught:
        tf.set_transforms_xact(rows, authority="hand")
    assert caught.value.frame == "part_3"
    assert tf.frames() == []
    tree = TransformTree()
    with pytest.raises(InvalidArgumentException, match=r"\(index 3\)"):
        tree.set_transforms_xact(rows)
    assert tree.frames() == []


@pytest.mark.parametrize("announce", [False, True], ids=["sent", "announced"])
def test_a_static_row_costs_itself(
    server: ServerProcess, tf: TransformClient, announce: bool
) -> None:
    """Mounts of a URDF of which one is not finite, sent and announced to a new server."""
    sender = f"mounts {announce}"
    mounts = [
        ("base", "camera", 0, at(0.1, 0, 0.2)),
        ("base", "lidar", 0, at(0, nan, 0)),
        ("base", "", 0, at(0, 0, 0)),
        ("camera", "x" * 300, 0, at(0, 0, 0)),
        ("camera", "optical", 0, (0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5)),
    ]
    commit = wire.Commit(TransformRows.of_tuples(mounts), announce=announce)
    with raw(server.endpoint) as wires:
        wires.put(sender, wire.commit_body(commit), static=True)
        record = wait_for_refusals(tf, sender, 3)
    assert record.refused_by_reason == {"not_finite": 1, "empty_name": 1, "long_name": 1}
    assert record.stored == 2 and sorted(tf.frames()) == ["base", "camera", "optical"]
    assert tf.lookup_transform("base", "optical")


def put(tree: TransformTree, *links: tuple[str, str, int], authority: str = "a") -> list[str]:
    """Commit links as a put. Returns of each row what became of it."""
    rows = TransformRows.of_tuples([(*link, at(0, 0, 0)) for link in links])
    (outcome,) = tree._commit_puts([rows], [authority], [None])
    assert not isinstance(outcome, Exception)
    stored = outcome or b"\1" * len(rows)
    found = refused(tree, rows, stored)
    assert (found is None) == (max(stored) < 3)
    assert found is None or len(found.errors) == found.total
    return [("old", "stored")[code] if code < 2 else REASONS[code] for code in stored]


@pytest.mark.parametrize("order", [1, -1])
def test_a_link_that_closes_a_loop_costs_itself(order: int) -> None:
    tree = TransformTree()
    put(tree, ("map", "odom", S), ("odom", "base", S))
    rows = [("base", "map", 2 * S), ("odom", "base", 2 * S), ("base", "arm", 2 * S)]
    found = put(tree, *rows[::order])
    assert found[::order] == ["cycle", "stored", "stored"]
    assert tree.chain("map", "arm") == ["map", "odom", "base", "arm"]
    # Links that change places at one instant are no loop.
    assert put(tree, ("base", "odom", 3 * S), ("map", "base", 3 * S)) == ["stored", "stored"]


def test_rows_above_a_limit_or_of_another_authority_cost_themselves() -> None:
    few = TransformTree(max_frames=3)
    found = put(few, ("map", "odom", S), ("odom", "new", S), ("new", "over", S), ("map", "odom", 2))
    assert found == ["stored", "stored", "frame_limit", "stored"]
    deep = TransformTree(max_depth=2)
    found = put(deep, ("a", "b", S), ("b", "c", S), ("c", "d", S), ("a", "e", S))
    assert sorted(found) == ["stored", "stored", "stored", "too_deep"]
    owned = TransformTree(one_authority_per_frame=True)
    put(owned, ("map", "odom", S), authority="amcl")
    found = put(owned, ("map", "odom", 2 * S), ("odom", "base", 2 * S), authority="wheels")
    assert found == ["other_authority", "stored"]


def test_a_put_that_stores_nothing_is_no_commit() -> None:
    tree = TransformTree()
    put(tree, ("map", "odom", 100 * S))
    before = tree.stats()
    assert put(tree, ("map", "odom", S)) == ["old"]
    assert put(tree, ("odom", "odom", S), ("", "x", S)) == ["own_parent", "empty_name"]
    after = tree.stats()
    assert after["commits"] == before["commits"] == 1
    assert after["dropped"] == before["dropped"] + 1
    (record,) = tree.authorities()
    assert (record.commits, record.stored, record.dropped) == (1, 1, 1)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("world:robot::lidar", ["world", "robot::lidar"]),
        ("a::b::c:map:x::y", ["a::b::c", "map", "x::y"]),
        (r"map:model\:arm:base", ["map", "model:arm", "base"]),
    ],
)
def test_names_with_colons_in_the_frames_of_a_mirror(text: str, names: list[str]) -> None:
    """gazebosim/ros_gz#848: `model::link::sensor`."""
    found = parsed(f"r=tcp/10.0.0.1:7447/main,frames={text}")
    assert found.links[0].share.interest is not None
    pairs = sorted((min(pair), max(pair)) for pair in pairwise(names))
    assert list(found.links[0].share.interest.pairs) == pairs


@pytest.mark.parametrize("text", ["robot::lidar", "map:", r"a\:b", ":"])
def test_colons_that_leave_no_two_frames(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed(f"r=tcp/10.0.0.1:7447/main,frames={text}")
    assert "two or more frames" in capsys.readouterr().err


def parsed(robot: str) -> FederationSettings:
    return flags.settings(flags.parse(["--mirror-of", robot])).federation
