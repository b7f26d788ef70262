"""The server's log: safe and short whatever a record contains, as text and as JSON."""

from __future__ import annotations

import fcntl
import json
import logging
import os
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support import messages
from tests.support.raw import raw
from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf_client import TransformClient
from zenoh_tf_server.monitoring import logs
from zenoh_tf_server.monitoring.log_handler import DescriptorHandler

HOSTILE = "\n2026-01-01 INFO root: forged\r\x1b[31m\x00\x7f\x85\x9b\u2028\u2029\u202e\u2066"
FORMATS = ("text", "json")


def formatter(form: str) -> logging.Formatter:
    return logs.JsonFormatter() if form == "json" else logs.TextFormatter()


def record(message: str, *args: object, **more: Any) -> logging.LogRecord:
    error = more.pop("error", None)
    info = (type(error), error, error.__traceback__) if error else None
    made = logging.LogRecord("zenoh_tf.server", logging.WARNING, "x", 1, message, args, info)
    vars(made).update(more)
    return made


def raised(error: Exception) -> Exception:
    try:
        raise error
    except Exception as caught:
        return caught


@pytest.mark.parametrize("form", FORMATS)
def test_every_line_is_printable_and_short(form: str) -> None:
    records = [
        record("put of %s", HOSTILE),
        record(HOSTILE * 1_000_000),
        record("%s", "\\\"'" * 1_000_000),
        record("\N{PILE OF POO}" * 1_000_000),
        record("\ud800" * 10_000),
        record("%d", "not a number"),
        record("with fields", **{HOSTILE * 9: HOSTILE * 99, "a": [HOSTILE], "time": HOSTILE}),
        record("long names", **{f"{index}" + "\U000e0001" * 40: "x" for index in range(100)}),
        record("wide names", **{f"{index}" + "\N{PILE OF POO}" * 40: "x" for index in range(100)}),
        record("many", **{f"field{index}": "x" * 1000 for index in range(100)}),
        record("failed", error=raised(ValueError(HOSTILE * 10_000))),
        record("failed", error=raised(ValueError("\n" * 10_000_000))),
    ]
    for each in records:
        lines = formatter(form).format(each).split("\n")
        assert all(line.isprintable() for line in lines)
        assert sum(len(line.encode()) for line in lines) <= logs.MAX_JSON_BYTES
        if form == "json" or not each.exc_info:
            assert len(lines) == 1
            assert each.exc_info or len(lines[0].encode()) <= logs.MAX_LINE_BYTES
        if form == "json":
            fields = json.loads(lines[0])
            assert fields["level"] == "warning" and fields["logger"] == "zenoh_tf.server"
            assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", fields["time"])
            for line in "\n".join(map(str, fields.values())).split("\n"):
                assert line.isprintable()  # also after it was parsed


def test_the_lines_of_a_traceback_cannot_pass_for_records() -> None:
    text = logs.TextFormatter().format(record("failed", error=raised(ValueError(HOSTILE))))
    first, *others = text.split("\n")
    assert first.endswith("zenoh_tf.server: failed")
    assert all(line.startswith("    | ") for line in others)
    assert any("forged" in line for line in others)
    assert any("Traceback" in line for line in others)


def test_fields_of_a_call_are_json_values() -> None:
    made = record("refused", authority="lidar", count=3, ratio=0.5, bad=float("nan"), none=None)
    fields = json.loads(logs.JsonFormatter().format(made))
    expected = {"authority": "lidar", "count": 3, "ratio": 0.5, "bad": "nan", "none": None}
    assert expected.items() <= fields.items()


def assert_safe(log: str, form: str) -> list[dict[str, Any]]:
    assert log.replace("\n", "").isprintable()
    records = []
    for line in log.splitlines():
        assert len(line.encode()) <= logs.MAX_LINE_BYTES
        if form == "json":
            records.append(json.loads(line))
        else:
            assert re.match(r"\d{4}-\d\d-\d\dT[0-9:.]+Z (DEBUG|INFO|WARNING|ERROR) ", line), line
    return records


def hostile_puts() -> dict[str, bytes]:
    """Messages by authority; the last one has a malformed field of almost 16 MB."""
    one = messages.commit([], [0], [1])
    huge = wire.MAX_MESSAGE_BYTES // len(HOSTILE.encode()) - 10
    return {
        "a": wire.pack({**one, "names": [HOSTILE, HOSTILE]}),
        "b": wire.pack({**one, "names": ["map", HOSTILE * 40]}),
        "c": wire.pack({**one, "v": HOSTILE}),
        "d": wire.pack({**one, "names": HOSTILE}),
        HOSTILE[:80]: b"\xc1 not msgpack \n",
        "last": wire.pack({"v": HOSTILE * huge}),
    }


@pytest.mark.parametrize("form", FORMATS)
def test_hostile_messages_never_reach_the_log_raw(start_server: StartServer, form: str) -> None:
    server = start_server("--log-format", form, "--log-level", "debug")
    puts = hostile_puts()
    with zenoh.open(zenoh_config.client([server.endpoint], 5.0)) as session, server.connect() as tf:
        for authority, payload in puts.items():
            session.put(
                keys.put("main", authority, static=False),
                payload,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        # A key that the server's own escaping would never make.
        key = "tf/v1/main/set/\x1b]0;title\x07\x85"
        session.put(key, b"", congestion_control=zenoh.CongestionControl.BLOCK)
        while tf.stats()["bad_puts"] < len(puts) + 1:
            time.sleep(0.02)
        with raw(server.endpoint) as wires:
            for what in ("remove_frame", HOSTILE):
                wires.error("admin", {"v": 1, "what": what, "name": HOSTILE * 3})
        tf.clear()
    assert server.stop() == 0
    log = server.log
    records = assert_safe(log, form)
    assert log.count("put of 'last'") == 1
    assert "forged" in log
    if form == "json":
        assert {each["level"] for each in records} >= {"info", "warning"}


def test_each_place_that_logs_has_a_bounded_rate(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    error = raised(ValueError("defect"))
    path = tmp_path / "log"
    with path.open("wb") as file:
        handler = DescriptorHandler(file.fileno())
        handler.setFormatter(logs.TextFormatter())
        for number in range(10_000):
            handler.handle(record(f"cleared {number}"))
        handler.handle(record("another place", lineno=2))
        for _ in range(10_000):
            handler.handle(record("failed", error=error, lineno=3))
        lines = path.read_text().splitlines()
        assert sum("cleared" in line for line in lines) == 100
        assert sum("another place" in line for line in lines) == 1
        assert sum("ValueError: defect" in line for line in lines) == 5
        now_s += 6.0
        handler.handle(record("cleared again"))
        assert path.read_text().endswith("cleared again (9900 more were suppressed)\n")


def test_a_reader_that_does_not_read_loses_records_and_holds_nobody_up() -> None:
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    handler = DescriptorHandler(write)
    handler.setFormatter(logs.TextFormatter())
    for number in range(200):  # each on a line of its own, so that no rate is reached
        handler.handle(record("x" * 1000, lineno=number))
    lines = os.read(read, 1 << 20).decode().splitlines()
    assert 0 < len(lines) < 100
    deadline = time.monotonic() + 20
    while True:  # records come again once there is a reader, after a pause
        handler.handle(record("again", lineno=150))
        if select.select([read], [], [], 0.05)[0]:
            break
        assert time.monotonic() < deadline
    assert "again (" in os.read(read, 1 << 20).decode()
    os.close(read)
    handler.handle(record("to nobody", lineno=300))
    os.close(write)


def test_a_log_that_nobody_reads_stops_no_server() -> None:
    """As a terminal after Ctrl-S."""
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    endpoint = free_endpoint()
    process = forks.Popen(
        [sys.executable, "-m", "zenoh_tf_server", "--listen", endpoint],
        stdout=subprocess.DEVNULL,
        stderr=write,
    )
    try:
        os.close(write)
        with TransformClient.connect(endpoint, timeout_s=20.0) as tf:
            for _ in range(500):
                tf.clear()
        process.terminate()
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.wait()
        os.close(read)


def test_uncaught_exceptions_and_warnings_are_records() -> None:
    code = (
        "import threading, warnings\n"
        "from zenoh_tf_server.monitoring import logs\n"
        "logs.setup(logs.LogSettings(format='json'))\n"
        "warnings.warn('\\x1b[31mred\\n')\n"
        "def fail(): raise ValueError('\\x1b in a thread')\n"
        "thread = threading.Thread(target=fail, name='t\\x1b')\n"
        "thread.start(); thread.join()\n"
        "raise ValueError('\\x1b at the end')\n"
    )
    done = forks.run([sys.executable, "-c", code], timeout=150)
    warning, in_thread, at_end = map(json.loads, done.stderr.splitlines())
    assert "\x1b" not in done.stderr
    assert warning["logger"] == "py.warnings" and "red" in warning["message"]
    assert in_thread["message"] == "uncaught exception in thread t\\x1b"
    assert in_thread["traceback"].endswith("ValueError: \\x1b in a thread")
    assert at_end["level"] == "critical"
    assert done.returncode == 1


def test_the_log_of_a_quiet_server_is_short(start_server: StartServer) -> None:
    """Clients that come and go leave no line at the default level."""
    server: ServerProcess = start_server()
    for _ in range(3):
        with server.connect() as tf:
            tf.frames()
    server.send_signal(signal.SIGTERM)
    assert server.process.wait(10) == 0
    assert len(server.log.splitlines()) <= 5, server.log
