"""Bad stamps and clocks, over real servers: refused, reported by name, and no harm to others."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from zenoh_tf import (
    AuthorityInfo,
    InvalidArgumentException,
    StampedTransform,
    Transform,
    keys,
    wire,
)
from zenoh_tf_client import TransformClient

from .conftest import ServerProcess, StartServer
from .raw import raw

YEAR_S = 365 * 86_400.0
TIMEOUT_S = 30.0


def at(child: str, ahead_s: float = 0.0, parent: str = "map") -> StampedTransform:
    """A transform stamped now, or so many seconds ahead."""
    return StampedTransform(parent, child, time.time_ns() + int(ahead_s * 1e9), Transform())


def wait(done: Callable[[], object], what: str) -> None:
    deadline_s = time.monotonic() + TIMEOUT_S
    while not done():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.02)


def authority(tf: TransformClient, name: str) -> AuthorityInfo:
    return next(each for each in tf.authorities() if each.name == name)


def wait_for_log(server: ServerProcess, *texts: str) -> None:
    wait(lambda: all(text in server.log for text in texts), f"no {texts} in\n{server.log}")


@pytest.mark.parametrize("time_jump", ["reject", "clear"])
def test_one_bad_stamp_harms_nobody(start_server: StartServer, time_jump: str) -> None:
    server = start_server("--time-jump", time_jump)
    with server.connect() as tf:
        good, bad = tf.broadcaster("good"), tf.broadcaster("bad")
        for _ in range(5):
            good.send([at("base"), at("arm")])
        wait(lambda: tf.stats()["put_transforms"] == 10, "stored")
        for ahead_s in (YEAR_S, -3600.0):
            bad.send([at("base", ahead_s), at("cup", parent="arm")])
            good.send([at("base"), at("arm")])
        wait(lambda: tf.stats()["puts"] == 9, "ingested")
        assert (tf.frame("base").samples, tf.frame("arm").samples) == (7, 7)
        assert tf.frame("cup").samples == 2  # the good rows of a message with a bad one
        assert tf.stats()["time_jumps"] == 0
        assert abs(tf.frame("base").delay_s() or 0.0) < 60
        record = authority(tf, "bad")
        assert record.refused == 1
        assert record.last_refusal is not None and "'base'" in record.last_refusal
        assert tf.stats()["from_future"] == 1
        wait_for_log(server, "'bad': from the future", "s ahead of this server's clock: the limit")
        wait_for_log(server, "frame 'base': late: 'bad' sent a stamp")


@pytest.mark.parametrize("time_jump", ["reject", "clear"])
def test_a_stored_stamp_far_ahead_does_not_end_the_frame(
    start_server: StartServer, time_jump: str
) -> None:
    server = start_server("--time-jump", time_jump, "--future", "flag")
    with server.connect() as tf:
        good, bad = tf.broadcaster("good"), tf.broadcaster("bad")
        good.send([at("base"), at("arm")])
        wait(lambda: tf.stats()["puts"] == 1, "ingested")
        bad.send(at("base", YEAR_S))
        wait(lambda: tf.stats()["flagged_as_future"] == 1, "flagged")
        assert (tf.frame("base").delay_s() or 0.0) < -YEAR_S / 2
        for _ in range(3):
            good.send([at("base"), at("arm")])
        wait(lambda: tf.stats()["puts"] == 5, "ingested")
        assert tf.frame("base").samples == 2  # the first one was the first witness
        assert tf.frame("arm").samples == 4
        assert (tf.frame("base").time_jumps, tf.frame("arm").time_jumps) == (1, 0)
        assert abs(tf.frame("base").delay_s() or 0.0) < 60
        wait_for_log(server, "'bad': from the future", "frame 'base': time_jump: 'good' went on at")


def test_a_call_from_the_future_is_refused(start_server: StartServer) -> None:
    server = start_server("--max-future-s", "60")
    with server.connect() as tf:
        for write in (tf.set_transform, lambda row: tf.set_transforms_xact([row])):
            with pytest.raises(InvalidArgumentException) as caught:
                write(at("base", 120))
            assert (caught.value.frame, caught.value.field) == ("base", "stamp_ns")
            assert "--max-future-s" in str(caught.value) and "60 s" in str(caught.value)
        with tf.batch() as batch:
            refused = batch.set_transform(at("base", 120))
        assert isinstance(refused.exception(), InvalidArgumentException)
        assert tf.frames() == []
        assert tf.set_transform(at("base", 30))
        tf.set_transform(at("camera", YEAR_S), static=True)
        tf.set_transform(StampedTransform("map", "simulated", 1, Transform()))


def test_without_a_limit_any_stamp_is_stored(start_server: StartServer) -> None:
    with start_server("--max-future-s", "0").connect() as tf:
        assert tf.set_transform(at("base", YEAR_S))


def test_clocks_that_are_off_are_reported_by_name(server: ServerProcess) -> None:
    with server.connect() as tf:
        offsets = {"exact": 0.0, "ahead": 10.0, "behind": -10.0, "simulated": -time.time() + 5}
        sensors = {name: tf.broadcaster(name) for name in offsets}
        drift_s = 0.0

        def sent_and_seen(lines: tuple[str, ...]) -> bool:
            nonlocal drift_s
            for name, sensor in sensors.items():
                sensor.send(at(name, offsets[name]))
            drifting.send(at("drifting", drift_s))
            drift_s += 0.2
            return all(line in server.log for line in lines)

        with tf.broadcaster("drifting") as drifting:
            wait(lambda: sent_and_seen(("authority 'ahead': ", "authority 'behind': ")), server.log)
            ahead, behind = authority(tf, "ahead"), authority(tf, "behind")
            exact, drifts = authority(tf, "exact"), authority(tf, "drifting")
        for record, offset_s in ((ahead, 10.0), (behind, -10.0), (exact, 0.0)):
            least_s, greatest_s = record.clock_offset_min_s, record.clock_offset_max_s
            assert least_s is not None and greatest_s is not None
            assert least_s <= greatest_s <= offset_s  # what is missing is the delay
            assert greatest_s > offset_s - 5
            assert record.stamp_age_s is not None and record.stamp_age_s >= -offset_s
        assert drifts.clock_offset_min_s is not None and drifts.clock_offset_max_s is not None
        assert drifts.clock_offset_min_s < drifts.clock_offset_max_s
        for name in ("exact", "simulated"):
            assert f"authority '{name}'" not in server.log
        assert tf.stats()["put_transforms"] == tf.stats()["puts"]  # none was refused


def test_a_client_whose_clock_is_off_is_reported(server: ServerProcess) -> None:
    with raw(server.endpoint) as wires, server.connect() as exact:
        name = str(wires.session.zid())
        token = wires.session.liveliness().declare_token(keys.client("main", name))

        def told() -> bool:
            body = {"clock_ns": time.time_ns() + 40_000_000_000, "round_trip_ns": 1_000_000}
            wires.session.get(
                keys.operation("main", "hello"),
                payload=wire.pack(wire.call_body("hello", **body)),
                attachment=name.encode(),
            ).recv()
            return f"client '{name}': its clock is " in server.log

        wait(told, server.log)
        wait_for_log(server, "s ahead of this server's clock")
        assert str(exact._connection.session.zid()) not in server.log
        token.undeclare()


def test_two_authorities_that_fight_are_reported(server: ServerProcess) -> None:
    with server.connect() as tf:
        left, right = tf.broadcaster("left\x1b[31m"), tf.broadcaster("right")

        def fought() -> bool:
            for _ in range(20):
                left.send(at("base", parent="map"))
                right.send(at("base", parent="dock"))
            return "fight over it: it changed hands" in server.log

        wait(fought, server.log)
        wait_for_log(
            server, "frame 'base': conflict: ", "'right'", "left\\x1b[31m", "flip its parent"
        )
        assert "\x1b" not in server.log
        assert server.log.count("conflict") < 30  # a bounded rate
        assert authority(tf, "right").conflicts > 1
