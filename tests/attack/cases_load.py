"""Attacks 1, 2, 4, 7, 13 and 28: what clients do to each other's calls."""

from __future__ import annotations

import statistics
import threading
import time

import numpy as np

from tests.support import messages
from zenoh_tf._net import keys

from .arena import P99_RATIO, Arena, Finding, attackers, beside, case, message_cost

ALL = ("lookup", "set", "info")
_FROZEN_S = 20.0


@case("1: a client with four unread replies of 6.5 MB is stopped", ("frozen", "4", "100000"))
@case("1b: two such clients", ("frozen", "4", "100000"), ("frozen", "4", "100000"))
@case("1c: a client with 200 unread replies of 65 kB is stopped", ("frozen", "200", "1000"))
def _frozen(arena: Arena, *each: tuple[str, ...]) -> list[Finding]:
    with arena.server() as server, attackers(server, *each) as begin:
        found = beside(server, ALL, begin, _FROZEN_S, load=len(each) + 1)
    return found.outages()


@case("2: a commit of 2.3 MB out of order into a ring of 33,000 samples, and one lookup of it")
def late_rows(arena: Arena) -> list[Finding]:
    rows = 33_000
    stamps = 1_000_000_000 + np.arange(rows) * 100_000
    parent, child = np.zeros(rows), np.ones(rows)
    ask = messages.pack(messages.same_lookup(1, "root", "ring"))
    with (
        arena.server() as server,
        messages.session(server.endpoint) as opened,
        messages.session(server.endpoint) as reading,
    ):
        newer = messages.commit(["root", "ring"], parent, child, stamps + 50_000)
        messages.send(opened, "commit", newer)
        late = messages.commit(["root", "ring"], parent, child, stamps[::-1])
        payload = messages.pack(late)

        def attack() -> None:
            committing = threading.Thread(target=messages.send, args=(opened, "commit", payload))
            committing.start()
            while committing.is_alive():
                messages.send(reading, "lookup", ask)
                time.sleep(0.01)

        found = beside(server, ALL, attack, 8.0)
        for body in (newer, late):
            body["names"] = ["root", "ring measured alone"]
        messages.send(opened, "commit", newer)
        findings, _ = message_cost(server, opened, "commit", messages.pack(late))
    return [*found.outages(), *findings]


@case("4: an honest client's batches of 99,000 lookups and a set, beside another client's sets")
def remembered_replies(arena: Arena) -> list[Finding]:
    with arena.server() as server, attackers(server, ("remembered", "99000")) as begin:
        found = beside(server, ["set"], begin, 12.0)
    window = found.attack
    sets = [call for call in found.calls["set"] if window.start_s < call.end_s < window.end_s]
    refused = sum(call.outcome != "ok" for call in sets)
    note = f"of {len(sets)}"
    return [Finding("refused sets of another client", refused, "", 0, note), *found.outages()]


@case("7: a commit of 1.6 MB makes a chain of 20,000 new frames")
def long_chain(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        payload = messages.pack(messages.chain("long", 20_000))

        def attack() -> None:
            sending = threading.Thread(target=messages.send, args=(opened, "commit", payload))
            sending.start()
            for index in range(100):  # another sensor has new frames meanwhile
                new = messages.pack(messages.star(f"other{index}_", 0, 1))
                opened.put(keys.put(messages.TREE, "other", static=False), new)
                time.sleep(0.02)
            sending.join()

        found = beside(server, ["new", "sensor"], attack, 10.0)
        again = messages.pack(messages.chain("more", 20_000))
        findings, _ = message_cost(server, opened, "commit", again)
    return [*found.outages(), _age(found.ages()), *findings]


@case("7b: a message of 3.9 kB on a chain of 1,000,000 frames")
def chain_extended(arena: Arena) -> list[Finding]:
    with arena.opened() as (server, opened):
        depth, rows = 0, 2000
        while depth < 1_000_000:  # as far as the server lets it grow, upwards from the leaf
            names = [f"deep{depth + index}" for index in range(rows + 1)]
            up = np.arange(rows)[::-1]
            body = messages.commit(names, up + 1, up)
            if messages.send(opened, "commit", body)[1]:
                break
            depth += rows
        payload = messages.pack(messages.chain("on", 45, "deep0"))
        findings, _ = message_cost(server, opened, "commit", payload)
    return [*findings, Finding("depth reached", depth, "frames")]


def _age(ages: list[float]) -> Finding:
    note = f"median {statistics.median(ages):.0f} ms" if ages else ""
    worst = max(ages, default=float("nan"))
    return Finding("age of a sensor's data at most", worst, "ms", note=note)


@case(
    "13: lookups of 100,000 rows by 1 client, beside a light client",
    ("lookups", "100000", "probe_base"),
)
@case(
    "13b: the same by 2 clients",
    ("lookups", "100000", "probe_base"),
    ("lookups", "100000", "probe_base"),
)
@case("13c: the same by 4 clients", *[("lookups", "100000", "probe_base")] * 4)
@case("13d: lookups of 100,000 failing rows by 1 client", ("lookups", "100000", "unknown"))
@case(
    "13e: floods of puts of one transform by 4 publishers",
    *[("puts", "1", f"flood{index}") for index in range(4)],
)
@case(
    "13f: one publisher of puts of 100,000 transforms, beside a sensor of 50 Hz",
    ("puts", "100000", "large"),
)
def _beside_load(arena: Arena, *each: tuple[str, ...]) -> list[Finding]:
    with arena.server() as server, attackers(server, *each) as begin:
        found = beside(server, ["lookup", "sensor"], begin, 8.0, load=len(each) + 1)
    outage = found.outages()[0]
    return [found.p99("lookup", P99_RATIO), outage, _age(found.ages())]


@case("28: a robot sends 333,000 transforms/s, lies about names and restarts every second")
def lying_robot(arena: Arena) -> list[Finding]:
    with (
        arena.opened() as (server, opened),
        attackers(server, ("liar", server.endpoint)) as begin,
    ):
        found = beside(server, ["lookup", "sensor"], begin, 10.0)
        stats = messages.stats(opened)
    note = (
        f"{stats['puts']:,} puts, {stats['frames']:,} frames, {stats['dropped_as_stale']:,} stale"
    )
    stored = Finding("transforms of puts that were stored", stats["put_transforms"], "", note=note)
    return [found.age_ratio(50, 2.0), found.age_ratio(99, 2.0), found.outages()[0], stored]
