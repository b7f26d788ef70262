"""Mirrors of some pairs of frames beside faults and random traffic: right again soon, and equal to
the mirror of everything."""

from __future__ import annotations

import random
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.conftest import StartServer
from tests.processes.mirror_process import MirrorProcess
from tests.processes.servers import ServerProcess
from tests.support.raw import raw
from tests.support.small_robot import DEADLINE_S, robot, stamped
from tests.support.waiting import wait_until
from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf.errors import ProtocolError
from zenoh_tf_client import TransformClient

from .test_mirror_equal import NAMES, Traffic, wait_until_quiet


def test_a_stopped_mirror(server: ServerProcess, client: TransformClient) -> None:
    """It holds up nobody, and is right again soon; its stream is shared with one that continues."""
    pair = ("map", "gripper")
    robot(client, 1)
    with (
        server.connect() as other,
        other.mirror([pair], max_delay_s=0) as m,
        MirrorProcess(server.endpoint, "pair", *pair) as stopped,
    ):
        assert client.stats()["interests"] == 1
        stopped.freeze()
        for stamp in range(2, 400):
            robot(client, stamp)
        m.wait_for(client.last_receipt)
        assert m.lookup_transform(*pair).stamp_ns == 399
        stopped.go_on()
        expected = {name: client.frame(name).version for name in m.frames()}
        wait_until(lambda: stopped.state()["versions"] == expected, "it does not catch up")


def test_a_killed_client_leaves_nothing(server: ServerProcess, client: TransformClient) -> None:
    robot(client, 1)
    with MirrorProcess(server.endpoint, "pair", "map", "gripper") as killed:
        assert client.stats()["interests"] == 1
        killed.kill()
        wait_until(lambda: client.stats()["interests"] == 0, "a dead client's interest is left")


def test_garbage_on_the_stream(server: ServerProcess, client: TransformClient) -> None:
    robot(client, 1)
    pair = ("map", "gripper")
    with client.mirror([pair], max_delay_s=0) as m, raw(server.endpoint) as attacker:
        wanted = wire.Interest.of([pair])
        key = keys.stream("main", m.instance, wanted.id)
        for payload in (b"", b"\xc1" * 10, wire.pack({"v": 1, "instance": m.instance})):
            attacker.session.put(key, payload)
        for wrong in (
            {"id": "00"},
            {"target": b"\x09\0\0\0"},
            {"names": 1},
            {"period_ns": -1},
            {"target": b"", "source": b""},
        ):
            body = {"v": 1, "interest": wanted.fields() | wrong}
            (reply,) = attacker.session.get(
                keys.request("main", "snapshot"), payload=wire.pack(body)
            )
            refusal = reply.err
            assert refusal is not None
            error = wire.unpack(refusal.payload.to_bytes())["error"]
            assert isinstance(wire.decode_error(error), ProtocolError)
        robot(client, 2)
        m.wait_for(timeout_s=DEADLINE_S)
        assert m.lookup_transform(*pair).stamp_ns == 2
        assert client.stats()["interests"] == 1


@pytest.mark.parametrize("seed", [3, 4])
def test_equal_to_the_mirror_of_everything(start_server: StartServer, seed: int) -> None:
    """Random writes of several clients: names come and go, time is set back, the tree is cleared,
    frames are reparented. What a mirror of pairs answers is what the other one answers."""
    server = start_server(
        *("--limit", "frames=400", "--time-jump", "clear", "--limit", "samples_per_frame=20")
    )
    chance = random.Random(seed)
    clients = [server.connect(20) for _ in range(2)]
    traffics = [Traffic(tf, seed + i) for i, tf in enumerate(clients)]
    pairs = [(chance.choice(NAMES), chance.choice(NAMES)) for _ in range(3)]
    with server.connect(20) as tf:
        mirrors = [
            clients[0].mirror(pairs, max_delay_s=0),
            clients[1].mirror([(b, a) for a, b in pairs]),
            tf.mirror([("map", name) for name in NAMES]),
        ]
        full = tf.mirror()
        with ThreadPoolExecutor() as pool:
            running = [pool.submit(traffic.run, 400) for traffic in traffics]
            while not all(each.done() for each in running):
                for m in mirrors:
                    for a, b in pairs:
                        m.can_transform(a, b)
                time.sleep(0.02)
        for each in running:
            each.result()
        wait_until_quiet(tf)
        tf.set_transform(stamped("last", 1), static=True)
        stamps = np.array(sorted(set().union(*(traffic.stamps for traffic in traffics))))
        for m in (full, *mirrors):
            m.wait_for(tf.last_receipt, DEADLINE_S)
        for m in mirrors:
            has_pairs = m is not mirrors[2]
            for name in m.frames():
                mine, whole = m.frame(name), full.frame(name)
                for fact in ("parent", "authority", "static", "samples", "version"):
                    assert getattr(mine, fact) == getattr(whole, fact), (name, fact)
            for a, b in pairs:
                here, there = m.sample(a, b, stamps), full.sample(a, b, stamps)
                for stamp in stamps[here.ok != there.ok].tolist():
                    assert not has_pairs, (a, b, stamp)
                    # Of a pair that it was not asked for, the path may lead outside.
                    assert not {*full.chain(a, b, stamp)} <= {*m.frames()}
    for client in clients:
        client.close()
