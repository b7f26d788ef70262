"""Attacks 3, 10 and 11: what single messages cost the server, and what they use up for good."""

from __future__ import annotations

import re
import time

import zenoh

from tests.support import messages
from zenoh_tf import wire
from zenoh_tf.errors import TransformException

from .arena import ANY_MB, Arena, Finding, case, cost_findings, message_cost
from .processes import attacker, costs

_FRAMES = 1_000_000
_DEPTH = 999
#: A line of the log may not be longer, and the log may not grow by more for one message.
_LOG_KB = 64.0


@case("3a: a batch of 5.7 kB asks for `frames` of a tree of 1,000,000 frames")
def frames_of_a_large_tree(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        for first in range(0, _FRAMES, 100_000):
            body = messages.star("a_robot/some_frame_", first, 100_000)
            messages.send(opened, "commit", body)
        entry = ["info", {"what": "frames"}]
        payload = messages.pack({"v": 1, "operations": [entry] * 285})
        return message_cost(server, opened, "batch", payload)[0]


def _deep(arena: Arena, rows: int) -> tuple[list[Finding], bytes]:
    with arena.opened() as (server, opened):
        messages.send(opened, "commit", messages.chain("deep", _DEPTH))
        body = messages.same_lookup(rows, "root", f"deep{_DEPTH - 1}", versions=True)
        return message_cost(server, opened, "lookup", messages.pack(body))


@case("3b: a lookup of 1.7 MB with `versions`, each row of depth 999")
def deep_read_sets(arena: Arena) -> list[Finding]:
    return _deep(arena, 100_000)[0]


@case("3c: a name of 1 MB in 3,000 failing rows")
def long_names_in_errors(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        body = messages.same_lookup(3000, "x" * 1_000_000, "probe_base")
        return message_cost(server, opened, "lookup", messages.pack(body))[0]


@case("3d: 170 kB: 10,000 waiting rows of depth 2 x 999")
def deep_waiters(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        for prefix in ("left", "right"):
            body = messages.chain(prefix, _DEPTH, f"root of {prefix}")
            messages.send(opened, "commit", body)
        ends = f"left{_DEPTH - 1}", f"right{_DEPTH - 1}"
        # Not connected: a link anywhere on both paths could bring the answer.
        body = messages.same_lookup(10_000, *ends, op=1)
        payload = messages.pack({**body, "timeout_ns": 5_000_000_000})
        return message_cost(server, opened, "lookup", payload)[0]


@case("3e: 80 queued queries of 16 MB")
def queued_large_queries(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        messages.send(opened, "commit", messages.chain("deep", _DEPTH))
        slow = messages.pack(messages.same_lookup(100_000, "root", f"deep{_DEPTH - 1}"))
        large = messages.pack({"v": 1, "operations": [["info", {"what": "x" * 15_900_000}]]})
        large_lookup = messages.pack({**messages.same_lookup(1, "a", "b"), "pad": large})
        with costs(server, 5.0) as found:
            held = [messages.ask(opened, "lookup", slow) for _ in range(8)]
            held += [messages.ask(opened, "lookup", large_lookup) for _ in range(80)]
            replies = [reply for each in held for reply in each]
        answered = sum(reply.ok is not None for reply in replies)
        note = f"{answered} of {len(replies)} answered"
        peak = Finding("memory", found[0].peak_mb, "MB", 3 * ANY_MB, note)
        return [peak, Finding("memory that stays", found[0].left_mb, "MB", ANY_MB)]


@case("3f: a request of 51 kB has a reply that the SDK's decoder refuses")
def reply_too_large_to_decode(arena: Arena) -> list[Finding]:
    findings, reply = _deep(arena, 3000)
    refused = 0
    if reply:
        try:
            wire.unpack(reply, messages.MAX_REPLY)
        except TransformException:
            refused = 1
    return [*findings, Finding("replies that cannot be decoded", refused, "", 0)]


@case("10: a put of 16 MB with a malformed field; names with newlines and escape sequences")
def malformed_put_in_the_log(arena: Arena) -> list[Finding]:
    nasty = "evil\n2026-01-01 00:00:00 ERROR all is lost\x1b[31m\x9b\u2028\x07"
    with arena.opened() as (server, opened):
        with costs(server) as found:
            good = messages.star("a", 0, 1)
            loop = messages.commit([nasty], [0], [0])
            bad = [
                {**good, "v": "\x1b\n" * 7_500_000},
                {**good, "names": ["\x1b\n" * 7_500_000, "b"]},
                {**good, "\x1b\n" * 7_500_000: 1, "stamp": "x"},
                {**good, "authority": nasty, "stamp": nasty},
                loop,
            ]
            # Each from a source of its own, because the log repeats nothing of one source.
            for index, body in enumerate(bad):
                messages.put(opened, f"source {index}", body)
            messages.put(opened, nasty, b"\x81\xa1v\x01")
            opened.put(f"tf/v1/{messages.TREE}/set/%1B%0A", messages.pack({"v": 1, "names": 1}))
            opened.put(f"tf/v1/{messages.TREE}/set/\x1b]0;title\x07\n%", b"")
            for name in (nasty, "b\x1b[2J"):
                authority = messages.commit([nasty, "child"], [0], [0], authority=nasty)
                messages.send(opened, "commit", authority)
                messages.remove_frame(opened, name)
            one = messages.pack(messages.commit(["root", nasty], [0], [1]))
            messages.send(opened, "commit", one)
            messages.remove_frame(opened, nasty)
            time.sleep(1.0)
        log = server.log
    raw = len(re.findall(rb"[\x00-\x09\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\xa8\xa9]", log))
    raw += len(re.findall(rb"(?m)^2026-01-01", log))
    longest = max(map(len, log.splitlines()), default=0)
    return [
        Finding("log", len(log) / 1e3, "kB", _LOG_KB),
        Finding("longest line", longest / 1e3, "kB", _LOG_KB / 16),
        Finding("raw control characters", raw, "", 0),
        cost_findings(found[0], 16_000_000, 0, "")[1],
    ]


@case("11: 4,200 puts under different authorities, then a new sensor")
def many_authorities(arena: Arena) -> list[Finding]:
    with arena.opened() as (_, opened):
        for index in range(4200):
            body = messages.commit(["root", "f"], [0], [1], index + 1)
            messages.put(opened, f"authority {index}", body)
        _settle(opened)
        body = messages.commit(["root", "new"], [0], [1], authority="new sensor")
        reply, failed = messages.send(opened, "commit", body)
        note = messages.kind_of(reply, failed)
    return [Finding("a new sensor is refused", failed, "", 0, note)]


@case("11b: one message waits with 10,000 rows for 292 years, and its client dies")
def all_waiters(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        wait = messages.same_lookup(1, "root", "never")
        wait["timeout_ns"] = 200_000_000
        with attacker(server.endpoint, "waiters", "10000", "9.2e9") as greedy:
            greedy.go()
            greedy.stdout.readline()
            time.sleep(1.0)
            beside_it = messages.kind_of(*messages.send(opened, "lookup", wait))
        start_s = time.monotonic()
        while True:
            after = messages.kind_of(*messages.send(opened, "lookup", wait))
            held_s = time.monotonic() - start_s
            if after == "ok" or held_s > 15.0:
                break
            time.sleep(0.1)
    return [
        Finding("another's waiting lookup is refused", beside_it != "ok", "", 0, beside_it),
        Finding("waiters held after its death", held_s, "s", 2.0, after),
    ]


@case("11c: 500 frames are made and removed where 100 are allowed")
def names_that_come_and_go(arena: Arena) -> list[Finding]:
    refused = 0
    with arena.opened("--limit", "frames=100") as (_, opened):
        for index in range(500):
            one = messages.commit(["root", f"name {index}"], [0], [1])
            _, failed = messages.send(opened, "commit", one)
            refused += failed
            messages.remove_frame(opened, f"name {index}")
    return [Finding("refused new frames", refused, "", 0, "of 500")]


def _settle(opened: zenoh.Session) -> None:
    """Wait until the server has committed the puts: their count does not change any more."""
    before = -1
    while True:
        stats = messages.stats(opened)
        now = stats["puts"] + stats["bad_puts"]
        if now == before:
            return
        before = now
        time.sleep(0.3)
