"""Bad stamps and clocks, over real servers: refused, reported by name, and no harm to others."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import pytest

from tests.conftest import LendServer
from tests.processes.servers import ServerProcess
from tests.server.test_metrics import until, value
from tests.support.waiting import wait_until
from zenoh_tf import (
    AuthorityInfo,
    ClientInfo,
    InvalidArgumentException,
    StampedTransform,
    Transform,
)
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session import exchange
from zenoh_tf_server.ingest.clock_offsets import WINDOW_NS, ClockOffsets

YEAR_S = 365 * 86_400.0
TIMEOUT_S = 30.0


def at(child: str, ahead_s: float = 0.0, parent: str = "map") -> StampedTransform:
    """A transform stamped now, or so many seconds ahead."""
    return StampedTransform(parent, child, time.time_ns() + int(ahead_s * 1e9), Transform())


def authority(tf: TransformClient, name: str) -> AuthorityInfo:
    return next(each for each in tf.authorities() if each.name == name)


def is_measured(tf: TransformClient, name: str) -> bool:
    """True once the server knows a client's round trip."""
    client = clients(tf).get(name)
    return client is not None and client.clock_offset_max_s - client.clock_offset_min_s < 0.9


def wait_for_puts(tf: TransformClient, count: int) -> None:
    wait_until(lambda: tf.stats()["puts"] == count, f"no {count} puts")


def clients(tf: TransformClient) -> dict[str, ClientInfo]:
    return {client.client: client for client in tf.clients()}


def wait_for_log(server: ServerProcess, *texts: str) -> None:
    wait_until(lambda: all(text in server.log for text in texts), f"no {texts} in\n{server.log}")


@pytest.mark.parametrize("time_jump", ["reject", "clear"])
@pytest.mark.own_server
def test_one_bad_stamp_harms_nobody(lend_server: LendServer, time_jump: str) -> None:
    server = lend_server("--time-jump", time_jump)
    with server.connect() as tf:
        good, bad = tf.broadcaster("good"), tf.broadcaster("bad")
        for _ in range(5):
            good.send([at("base"), at("arm")])
        wait_until(lambda: tf.stats()["put_transforms"] == 10, "stored")
        for ahead_s in (YEAR_S, -3600.0):
            bad.send([at("base", ahead_s), at("cup", parent="arm")])
            good.send([at("base"), at("arm")])
        wait_for_puts(tf, 9)
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
def test_a_sensor_with_a_wrong_clock_harms_only_its_own_frame(
    lend_server: LendServer, time_jump: str
) -> None:
    """Three sensors: 10 s ahead until its clock is set, drifting, and exact. The cache time is
    shorter than the error, so that the step back is more than a late sample."""
    server = lend_server("--time-jump", time_jump, "--cache-time", "5s")
    with server.connect() as tf:
        ahead, drifting, exact = (tf.broadcaster(name) for name in ("ahead", "drifting", "exact"))
        sent = 0
        while "authority 'ahead': its stamps are " not in server.log or sent < 30:
            ahead.send(at("ahead", 10.0))
            drifting.send(at("drifting", 2 + sent))
            exact.send(at("exact"))
            sent += 1
            wait_for_puts(tf, 3 * sent)
        wait_for_log(server, "s ahead of this server's clock", "authority 'drifting': its stamps")
        assert "authority 'exact'" not in server.log
        for _ in range(3):  # the clocks have been set: the first is the first witness
            ahead.send(at("ahead"))
            drifting.send(at("drifting"))
            exact.send(at("exact"))
        wait_for_puts(tf, 3 * sent + 9)
        for name in ("ahead", "drifting"):
            frame = tf.frame(name)
            assert (frame.samples, frame.time_jumps) == (2, 1)
            assert abs(frame.delay_s() or 0.0) < 5
            wait_for_log(server, f"frame '{name}': time_jump: '{name}' continued at")
        exactly = tf.frame("exact")
        assert (exactly.time_jumps, exactly.dropped) == (0, 0)
        assert authority(tf, "exact").dropped == authority(tf, "exact").refused == 0


@pytest.mark.parametrize("time_jump", ["reject", "clear"])
def test_a_stored_stamp_far_ahead_does_not_end_the_frame(
    lend_server: LendServer, time_jump: str
) -> None:
    server = lend_server("--time-jump", time_jump, "--future", "flag")
    with server.connect() as tf:
        good, bad = tf.broadcaster("good"), tf.broadcaster("bad")
        good.send([at("base"), at("arm")])
        wait_for_puts(tf, 1)
        bad.send(at("base", YEAR_S))
        wait_until(lambda: tf.stats()["flagged_as_future"] == 1, "flagged")
        assert (tf.frame("base").delay_s() or 0.0) < -YEAR_S / 2
        for _ in range(3):
            good.send([at("base"), at("arm")])
        wait_for_puts(tf, 5)
        assert tf.frame("base").samples == 2  # the first one was the first witness
        assert tf.frame("arm").samples == 4
        assert (tf.frame("base").time_jumps, tf.frame("arm").time_jumps) == (1, 0)
        assert abs(tf.frame("base").delay_s() or 0.0) < 60
        wait_for_log(
            server, "'bad': from the future", "frame 'base': time_jump: 'good' continued at"
        )


def test_a_call_from_the_future_is_refused(lend_server: LendServer) -> None:
    server = lend_server("--max-future-s", "60")
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


def test_without_a_limit_any_stamp_is_stored(lend_server: LendServer) -> None:
    with lend_server("--max-future-s", "0").connect() as tf:
        assert tf.set_transform(at("base", YEAR_S))


@pytest.mark.own_server
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
            wait_until(
                lambda: sent_and_seen(("authority 'ahead': ", "authority 'behind': ")), server.log
            )
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


class Ahead:
    """A module `time` whose real-time clock is ahead of the machine's."""

    def __init__(self, ahead_s: float) -> None:
        self._ahead_ns = round(ahead_s * 1e9)

    def __getattr__(self, name: str) -> Any:
        return getattr(time, name)

    def time_ns(self) -> int:
        return time.time_ns() + self._ahead_ns


@pytest.mark.parametrize("ahead_s", [10.0, -10.0])
@pytest.mark.own_server
def test_a_client_whose_clock_is_off_is_shown(
    lend_server: LendServer, monkeypatch: pytest.MonkeyPatch, ahead_s: float
) -> None:
    server = lend_server("--metrics", "127.0.0.1:0")
    with ExitStack() as stack:
        with monkeypatch.context() as patch:
            patch.setattr(exchange, "time", Ahead(ahead_s))
            off = stack.enter_context(server.connect())
            name = str(off._connection.session.zid())
            wait_until(lambda: is_measured(off, name), "measured")
        exact = stack.enter_context(server.connect())
        exact_name = str(exact._connection.session.zid())
        wait_until(lambda: is_measured(exact, exact_name), "measured")
        shown, own = clients(exact)[name], clients(exact)[exact_name]
        assert shown.clock_offset_min_s <= ahead_s <= shown.clock_offset_max_s
        assert shown.clock_age_s >= 0
        assert shown.address is not None and shown.address.startswith("tcp/127.0.0.1:")
        assert own.clock_offset_min_s <= 0 <= own.clock_offset_max_s
        direction = "ahead of" if ahead_s > 0 else "behind"
        wait_for_log(server, f"client '{name}': its clock is ", f"s {direction} this server's")
        assert f"client '{exact_name}'" not in server.log
        side, other = ("ahead", "behind") if ahead_s > 0 else ("behind", "ahead")
        found = until(server, lambda page: value(page, f"client_clock_{side}_seconds") > 5)
        assert value(found, f"client_clock_{side}_seconds") <= 10
        assert value(found, f"client_clock_{other}_seconds") == 0
        off.close()
        wait_until(lambda: name not in clients(exact), "forgotten")


def test_a_client_tells_its_clock_again(
    server: ServerProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock that drifts after the client has connected is measured, by reads and by writes."""
    monkeypatch.setattr(exchange, "_CLOCK_PERIOD_S", 0.05)
    monkeypatch.setattr(exchange, "_FIRST_CLOCK_PERIOD_S", 0.05)
    with server.connect() as tf, server.connect() as watching:
        name = str(tf._connection.session.zid())
        for ahead_s, call in (
            (20.0, tf.frames),
            (40.0, lambda: tf.set_transform(at("base", -60.0))),
        ):
            monkeypatch.setattr(exchange, "time", Ahead(ahead_s))

            def is_known(ahead_s: float = ahead_s, call: Callable[[], Any] = call) -> bool:
                call()
                found = clients(watching).get(name)
                return found is not None and found.clock_offset_max_s > ahead_s - 5

            wait_until(is_known, "known")


def test_a_drift_is_reported_once_the_exact_time_is_past() -> None:
    clocks = ClockOffsets()
    for second in range(-40, 1):
        arrival_ns = time.time_ns() + second * 10**9
        lead_ns = (second + 40) * 10**8  # a tenth of a second more each second
        clocks.put_arrived("drifting", arrival_ns, arrival_ns + lead_ns)
    ((owner, reason),) = clocks.suspicious()
    assert owner == "authority 'drifting'"
    least_s, greatest_s = re.findall(r"\d+\.\d", reason)[:2]
    assert 1.9 <= float(least_s) < float(greatest_s) == 4.0


def test_silence_is_no_wrong_clock() -> None:
    """An authority that is silent keeps its last record, and is not reported for ever."""
    clocks = ClockOffsets()
    now_ns = time.time_ns()
    clocks.put_arrived("talks", now_ns, now_ns + 10**10)
    clocks.put_arrived("silent", now_ns - 2 * WINDOW_NS, now_ns - 2 * WINDOW_NS + 10**10)
    assert [owner for owner, _ in clocks.suspicious()] == ["authority 'talks'"]
    (record,) = clocks.add_to([{"name": "silent"}])
    assert record["clock_offset_min_s"] == 10.0


def test_two_authorities_that_fight_are_reported(server: ServerProcess) -> None:
    with server.connect() as tf:
        left, right = tf.broadcaster("left\x1b[31m"), tf.broadcaster("right")

        def fought() -> bool:
            for _ in range(20):
                left.send(at("base", parent="map"))
                right.send(at("base", parent="dock"))
            return "both publish it: it changed hands" in server.log

        wait_until(fought, server.log)
        wait_for_log(
            server, "frame 'base': conflict: ", "'right'", "left\\x1b[31m", "flip its parent"
        )
        assert "\x1b" not in server.log
        assert server.log.count("conflict") < 30  # a bounded rate
        assert authority(tf, "right").conflicts > 1
