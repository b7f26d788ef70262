"""Attacks 5, 6, 9, 12 and 14: what is lost, what is wrong, and what is not reported."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.processes.ports import free_endpoint
from tests.support import messages
from zenoh_tf import wire

from .arena import Arena, Finding, case
from .processes import HERE, Process, Server, first_line

_YEAR_NS = 365 * 86_400 * 10**9
_HOUR_NS = 3600 * 10**9


def _script(server: Server, name: str, *arguments: str) -> Process:
    """A function of sdk.py in a process of the SDK that is attacked."""
    script = str(HERE / "sdk.py")
    command = [server.python, script, name, server.endpoint, *arguments]
    return Process(command, subprocess.DEVNULL)


@case("5: a static is corrected and a frame removed; the server freezes for 15 s and continues")
def correction_undone(arena: Arena) -> list[Finding]:
    with arena.server() as server, _script(server, "announce_statics") as sensor:
        with messages.session(server.endpoint) as opened:
            fixed = messages.commit(["root", "camera"], [0], [1], 1, static=True)
            fixed["pose"] = np.array([7, 0, 0, 0, 0, 0, 1], "<f8").tobytes()
            messages.send(opened, "commit", fixed)
            messages.remove_frame(opened, "lidar")
        server.signal(signal.SIGSTOP)
        time.sleep(15.0)
        server.signal(signal.SIGCONT)
        time.sleep(4.0)
        assert sensor.running
        with messages.session(server.endpoint) as opened:
            reply, _ = messages.send(opened, "lookup", messages.same_lookup(1, "root", "camera"))
            x = float(np.frombuffer(wire.unpack(reply)["pose"], "<f8")[0])
            frames = messages.value(opened, "info", "frames")
    return [
        Finding("correction undone", x != 7.0, "", 0, f"x is {x:g}"),
        Finding("removed frame back", "lidar" in frames, "", 0),
    ]


@case("6: one sample a year ahead, among good ones", _YEAR_NS, "reject")
@case("6b: the same with the time-jump policy `clear`", _YEAR_NS, "clear")
@case("6c: one sample an hour late, with the policy `reject`", -_HOUR_NS, "reject")
@case("6d: the same with the policy `clear`", -_HOUR_NS, "clear")
def _bad_stamp(arena: Arena, offset_ns: int, policy: str) -> list[Finding]:
    def put(child: str, stamp_ns: int, authority: str) -> None:
        messages.put(opened, authority, messages.commit(["root", child], [0], [1], stamp_ns))

    def samples(child: str) -> int:
        return int(messages.value(opened, "info", "frame", frame=child)["samples"])

    with arena.opened("--time-jump", policy) as (server, opened):
        start_ns = time.time_ns()
        for index in range(100):
            for child in ("bad", "other"):
                put(child, start_ns + index * 1000, f"sensor of {child}")
        time.sleep(1.0)
        before = samples("bad"), samples("other")
        put("bad", time.time_ns() + offset_ns, "sensor of bad")
        time.sleep(0.5)
        for _ in range(20):
            for child in ("bad", "other"):
                put(child, time.time_ns(), f"sensor of {child}")
            time.sleep(0.01)
        time.sleep(1.0)
        after = samples("bad"), samples("other")
        log = server.log
        newest_ns = messages.value(opened, "info", "frame", frame="bad")["newest_stamp_ns"]
        ahead_s = (newest_ns - time.time_ns()) / 1e9
    named = b"bad" in log
    return [
        Finding("its samples lost", before[0] + 20 - after[0], "", 0, f"{before[0]}, {after[0]}"),
        Finding("samples of others lost", before[1] + 20 - after[1], "", 0, f"{after[1]} left"),
        Finding("latest is ahead of now", max(0.0, ahead_s), "s", 60.0),
        Finding("not reported by name", not named, "", 0, f"log of {len(log)} bytes"),
    ]


@case("9: a set with a time-out of 0.5 s behind a commit that makes 20,000 frames")
def applied_after_unknown(arena: Arena) -> list[Finding]:
    with arena.server() as server, _script(server, "set_behind_a_stall") as script:
        with messages.session(server.endpoint) as opened:
            payload = messages.pack(messages.chain("long", 20_000))
            script.go()
            messages.send(opened, "commit", payload)
        outcome, applied_s = script.stdout.readline().split()
        note = f"the set: {outcome}"
    late_s = float(applied_s)
    return [Finding("applied after its expiry", max(0.0, late_s), "s", 0, note)]


@case("12: a static set by the command line, then kill -9 of the server and a new start")
def static_lost(arena: Arena) -> list[Finding]:
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as folder:
        flags = ["--state-dir", str(Path(folder, "state"))]
        with arena.server(*flags, endpoint=endpoint):
            command = [arena.python, "-m", "zenoh_tf_tools", "--connect", endpoint]
            command += ["set", "map", "dock", "1", "2", "3", "--static"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
        with (
            arena.server(*flags, endpoint=endpoint),
            messages.session(endpoint) as opened,
        ):
            reply, _ = messages.send(opened, "lookup", messages.same_lookup(1, "map", "dock"))
            lost = wire.unpack(reply)["status"] != b"\0"
    return [Finding("lost", lost, "", 0)]


@case("14: a call of a client after fork, and a new connect in the child")
def fork(arena: Arena) -> list[Finding]:
    findings = []
    for name in ("call_after_fork", "connect_after_fork"):
        with arena.server() as server, _script(server, name) as script:
            start_s = time.monotonic()
            line = first_line(script.stdout, 12.0)
            took_s = time.monotonic() - start_s
            findings.append(Finding(name.replace("_", " "), took_s, "s", 2.0, line or "hangs"))
    return findings


@case("14b: Ctrl-C in `connect` to a server that does not answer")
def interrupted_connect(arena: Arena) -> list[Finding]:
    with arena.server() as server, _script(server, "connect_to_nothing", "15") as script:
        time.sleep(1.0)
        start_s = time.monotonic()
        script.signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            script.process.wait(20.0)
        took_s = time.monotonic() - start_s
    return [Finding("Ctrl-C in connect takes", took_s, "s", 1.0)]


@case("14c: two authorities give a frame two parents by turns; 1,000 clears")
def fighting_authorities(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        for index in range(200):
            which = index % 2
            body = messages.commit([f"parent {which}", "torn frame"], [0], [1], index + 1)
            messages.put(opened, f"fighter {which}", body)
            time.sleep(0.005)
        time.sleep(1.0)
        reported = b"torn frame" in server.log and b"fighter" in server.log
        before = len(server.log)
        for _ in range(1000):
            messages.send(opened, "admin", {"v": 1, "what": "clear"})
        grown = len(server.log) - before
    return [
        Finding("the fight is not logged", not reported, "", 0),
        Finding("log of 1,000 clears", grown / 1e3, "kB", 16.0),
    ]
