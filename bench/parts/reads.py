"""Calls from Python: of an embedded tree, a server's memory, a mirror, and by query; beside them a
bare Zenoh query and tf2's Python binding. Then processes that read a server's memory."""

from __future__ import annotations

import contextlib
import functools
import itertools
import json
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import zenoh

from bench.machine import Usage
from bench.parts.chain import (
    CACHE_S,
    END_NS,
    PERIOD_NS,
    ROWS,
    SOURCE,
    TARGET,
    TIMES_NS,
    next_row,
    us_per_call,
)
from bench.process import Process, serve
from bench.report import Cell, Report, Trial, equal_poses
from bench.server import (
    LOOKUP,
    Server,
    fill,
    free_endpoint,
    query_client,
    session,
    shared_client,
    stamped,
)
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf_client import Mirror, TransformClient
from zenoh_tf_client.requests import lookups
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.process.network import open_session

#: The system's interpreter: python3-tf2 is packaged for it.
TF2 = "/usr/bin/python3"
COMMON, AT = "lookup(TARGET, SOURCE, latest)", "lookup(TARGET, SOURCE, next(times))"
#: Our statement, tf2's, lookups or sets of one call of ours, most microseconds each.
EMBEDDED = (
    ("tree.lookup_transform(TARGET, SOURCE)", COMMON, 1, 1.0),
    ("tree.lookup_transform(TARGET, SOURCE, next(times))", AT, 1, 1.0),
    ("tree.lookup_transforms(targets, sources, times_array)", AT, ROWS, 0.12),
    ("tree.sample(TARGET, SOURCE, times_array)", AT, ROWS, 0.12),
    ("tree.set_transform(build(), 'bench')", "store(build(), 'bench')", 1, 1.2),
    ("tree.lookup_latest_transform_xact(TARGET, SOURCE)", COMMON, 1, None),
)
#: Statements that all systems answer alike, and tf2's. At a time between two samples, so that all
#: links are interpolated; tf2 has no atomic lookup.
READS = {
    "latest common time": ("tree.lookup_transform(TARGET, SOURCE)", COMMON),
    "at a time": ("tree.lookup_transform(TARGET, SOURCE, at_ns)", AT),
    "latest, atomic": ("tree.lookup_latest_transform_xact(TARGET, SOURCE)", ""),
}
NAMES: dict[str, Any] = {
    "TARGET": TARGET,
    "SOURCE": SOURCE,
    "targets": [TARGET] * ROWS,
    "sources": [SOURCE] * ROWS,
    "times": itertools.cycle(TIMES_NS),
    "times_array": np.array(TIMES_NS),
    "at_ns": END_NS - 100 * PERIOD_NS + PERIOD_NS // 3,
    "build": lambda: stamped(next_row()),
}
#: Calls of one trial: of a tree in memory, and of a server.
CALLS, QUERIES = 20_000, 100
BARE_KEY = "bench/bare"
OWN, SHARED = "a tree of its own", "the server's memory"
COMMITS_PER_S = 1000


def embedded(report: Report) -> None:
    """Microseconds a lookup or a set beside tf2; a set includes making its transform."""
    tree = TransformTree(cache_time_s=CACHE_S)
    fill(tree)
    with _tf2() as theirs:
        if theirs is not None:
            ours = [tree.lookup_transform(TARGET, SOURCE, t or None) for t in (0, *TIMES_NS[:100])]
            poses = [list(each.transform.pose()) for each in ours]
            if not all(map(equal_poses, poses, theirs.ask(0))):
                raise SystemExit("the systems' answers differ")
        for statement, their_statement, rows, limit in EMBEDDED:
            runs = {"zenoh-tf": functools.partial(_ours, report, tree, statement, CALLS, rows)}
            if theirs is not None:
                runs["tf2"] = functools.partial(_theirs, report, theirs, their_statement)
            case = {"case": statement.removeprefix("tree."), "rows": rows}
            us = report.compare(case, runs, 15)["zenoh-tf"].values("us_per_call")
            if limit:
                report.target(f"{statement}, us", us, "<=", limit)


def reads(report: Report) -> None:
    """Microseconds a call; all modes of reading take turns, with the same answers."""
    embedded = TransformTree()
    with (
        Server() as server,
        shared_client(server.endpoint) as shared,
        query_client(server.endpoint) as query,
        query.mirror() as mirror,
        _bare_query(server) as bare,
        _tf2() as theirs,
    ):
        fill(embedded)
        fill(shared)
        mirror.wait_for(shared.last_receipt)
        trees: dict[str, TransformTree | TransformClient | Mirror]
        trees = {"embedded": embedded, "shared": shared, "mirror": mirror, "query": query}
        for name, (statement, their_statement) in READS.items():
            answers = {repr(eval(statement, NAMES | {"tree": tree})) for tree in trees.values()}
            if len(answers) > 1:
                raise SystemExit(f"the answers differ: {answers}")
            runs: dict[str, Callable[[], Trial]] = {}
            for system, tree in trees.items():
                calls = QUERIES if tree is query else CALLS
                runs[system] = functools.partial(_ours, report, tree, statement, calls)
            if name == "latest common time":
                runs["bare query"] = functools.partial(_ours, report, bare, "tree()", QUERIES)
            if theirs is not None and their_statement:
                runs["tf2"] = functools.partial(_theirs, report, theirs, their_statement)
            cells = report.compare({"case": name}, runs, 21)
            for system, base, sign, limit in (
                ("shared", "embedded", "<=", 1.5),
                ("mirror", "embedded", "<=", 1.1),
                ("query", "shared", ">=", 300),
                ("query", "bare query", "<=", 1.3),
            ):
                if base in cells:
                    values = cells[system].over(cells[base], "us_per_call")
                    report.target(f"{name}, {system} to {base}", values, sign, limit)
        if shared.reads != "shared":
            raise SystemExit("the server's memory was not read to the end")


def _ours(report: Report, tree: object, statement: str, calls: int, rows: int = 1) -> Trial:
    calls = (calls // 100 if report.quick else calls) // rows
    return {"us_per_call": us_per_call(statement, calls, NAMES | {"tree": tree}) / rows}


def _theirs(report: Report, tf2: Process, statement: str) -> Trial:
    return {"us_per_call": tf2.ask(f"{CALLS // 100 if report.quick else CALLS} {statement}")}


@contextlib.contextmanager
def _tf2() -> Iterator[Process | None]:
    """tf2's Python binding as a process; none, with a note, where it is not installed."""
    probe = f"{TF2} -c 'import tf2_py, geometry_msgs.msg, genpy'"
    if subprocess.getstatusoutput(probe)[0]:
        print("no tf2 for Python (Debian: python3-tf2): no comparison")
        yield None
        return
    with Process(TF2, "-m", "bench.parts.tf2_python") as process:
        yield process


@contextlib.contextmanager
def _bare_query(server: Server) -> Iterator[Callable[[], int]]:
    """An empty query with as many bytes as a lookup, of a server that does nothing else."""
    request = wire.pack(lookups.lookup_transform(TARGET, SOURCE).body())
    with session(server.endpoint) as client:
        reply_bytes = _query(client, LOOKUP, request)
    endpoint = free_endpoint()
    with Process.of(answer_bare, endpoint, reply_bytes), session(endpoint) as client:
        yield functools.partial(_query, client, BARE_KEY, bytes(len(request)))


def _query(client: zenoh.Session, key: str, payload: bytes) -> int:
    """The bytes of the reply to a query that is sent as the client sends its own."""
    once = zenoh.ConsolidationMode.NONE
    for reply in client.get(key, payload=payload, timeout=5.0, consolidation=once):
        assert reply.ok is not None
        return len(reply.ok.payload.to_bytes())
    raise SystemExit(f"no answer on {key}")


def answer_bare(endpoint: str, reply_bytes: int) -> None:
    """The least that a query can cost: built as the service is, of its session, a channel, and a
    worker that receives, reads the payload and replies."""
    reply = bytes(reply_bytes)
    with open_session([endpoint], [], Limits()) as session:
        channel: zenoh.handlers.FifoChannel[zenoh.Query] = zenoh.handlers.FifoChannel(256)
        queryable = session.declare_queryable(BARE_KEY, channel, complete=True)
        print("ready", flush=True)
        while True:  # until the benchmark ends it
            with queryable.handler.recv() as query:
                bytes(query.payload or b"")
                query.reply(zenoh.KeyExpr(BARE_KEY), reply)


def readers(report: Report) -> None:
    """Lookups a second of processes that read a server's memory at full rate, beside its commits,
    and the cores that the server uses."""
    seconds, ending = report.seconds(0.5), threading.Event()
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(Server())
        tf = stack.enter_context(shared_client(server.endpoint))
        fill(tf)
        processes = {
            system: [stack.enter_context(Process.of(read_at_full_rate, *where)) for _ in range(4)]
            for system, where in ((OWN, ()), (SHARED, (server.endpoint,)))
        }
        writer = threading.Thread(target=_write, args=(tf, ending))
        writer.start()
        stack.callback(writer.join)
        stack.callback(ending.set)
        trial = functools.partial(_trial, server.pid, seconds)
        cells = {(0, "none"): Cell({"reader processes": 0, "system": "none"}, lambda: trial([]))}
        for count in (1, 2, 4):
            for system, readers in processes.items():
                labels = {"reader processes": count, "system": system}
                run = functools.partial(trial, readers[:count])
                cells[count, system] = Cell(labels, run)
        report.measure(list(cells.values()))
    for count in (1, 2, 4):
        values = cells[count, SHARED].over(cells[count, OWN], "lookups_per_s")
        report.target(f"{count} processes, server's memory to own tree", values, ">=", 1 / 1.5)


def _trial(pid: int, seconds: float, readers: list[Process]) -> Trial:
    with Usage(pid) as usage:
        for reader in readers:
            reader.send(seconds)
        rates = [json.loads(reader.read_line()) for reader in readers]
        if not readers:
            time.sleep(seconds)
    cores = {"server_cores": usage.cpu_s[0] / usage.took_s}
    return cores | ({"lookups_per_s": sum(rates)} if rates else {})


def _write(tf: TransformClient, ending: threading.Event) -> None:
    """Commits two of the links that are read, together, at the rate."""
    next_s, stamp_ns = time.monotonic(), END_NS
    links, pose = (("map", "odom"), ("odom", "base_link")), Transform((1.0, 2.0, 3.0))
    while not ending.is_set():
        stamp_ns += 1_000_000_000 // COMMITS_PER_S
        tf.set_transforms_xact([StampedTransform(*link, stamp_ns, pose) for link in links])
        next_s += 1 / COMMITS_PER_S
        time.sleep(max(0.0, next_s - time.monotonic()))


def read_at_full_rate(*endpoint: str) -> None:
    """Reads the memory of the server there, or a tree of its own. Answers a number of seconds with
    its lookups a second meanwhile."""
    tree: TransformTree | TransformClient
    if endpoint:
        tree = shared_client(*endpoint)
    else:
        fill(tree := TransformTree())

    def lookups_per_s(seconds: str) -> float:
        calls, begun_s = 0, time.perf_counter()
        while time.perf_counter() - begun_s < float(seconds):
            for _ in range(500):
                tree.lookup_latest_transform_xact(TARGET, SOURCE)
            calls += 500
        return calls / (time.perf_counter() - begun_s)

    serve(lookups_per_s)
