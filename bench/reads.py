"""The ways of reading: an embedded tree, a server's memory, a mirror, a query; beside them a bare
Zenoh query and tf2's Python binding."""

from __future__ import annotations

import contextlib
import functools
import statistics
import timeit
from collections.abc import Callable, Iterator, Mapping

from bench import empty_server
from bench.embedded import AT, COMMON, tf2, trial
from bench.process import Process, ask, connect, listening, server
from bench.python_system import END_NS, PERIOD_NS, SOURCE, TARGET, history
from bench.queries import LOOKUP, fill
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf_client import Mirror, TransformClient
from zenoh_tf_client.requests import lookups

Call = Callable[[], object]
Tree = TransformTree | TransformClient | Mirror
#: Between two samples, so that all links are interpolated.
AT_NS = END_NS - 100 * PERIOD_NS + PERIOD_NS // 3
LATEST, AT_A_TIME, ATOMIC = "latest common time", "at a time", "latest, atomic"
QUESTIONS: dict[str, Callable[[Tree], object]] = {
    LATEST: lambda tree: tree.lookup_transform(TARGET, SOURCE),
    AT_A_TIME: lambda tree: tree.lookup_transform(TARGET, SOURCE, AT_NS),
    ATOMIC: lambda tree: tree.lookup_latest_transform_xact(TARGET, SOURCE),
}
#: The same lookups in tf2, by bench.python_system; it has no atomic one.
TF2 = {LATEST: COMMON, AT_A_TIME: AT}
#: Calls of one trial: of a tree in memory, and of a server.
CALLS, QUERIES = 20_000, 100


def measure(report: Report) -> None:
    """Microseconds a call of the Python API; all ways take turns, with the same answers."""
    embedded = TransformTree()
    with (
        server() as (_, endpoint),
        TransformClient.connect(endpoint) as shared,
        TransformClient.connect(endpoint, reads="query") as query,
        query.mirror() as mirror,
        _bare_query(endpoint) as bare,
        tf2() as theirs,
    ):
        if shared.reads != "shared":
            raise SystemExit("the server does not share its tree")
        for row in history():
            embedded.set_transform(StampedTransform(*row[:3], Transform(*row[3:])))
        fill(shared)
        mirror.wait_for(shared.last_receipt)
        trees: dict[str, Tree] = {"embedded": embedded, "shared": shared}
        trees |= {"mirror": mirror, "query": query}
        for name, question in QUESTIONS.items():
            answers = [question(tree) for tree in trees.values()]
            if len({repr(answer) for answer in answers}) > 1:
                raise SystemExit(f"the answers differ: {answers}")
            calls: dict[str, Call] = {}
            for way, tree in trees.items():
                calls[way] = functools.partial(question, tree)
            calls |= {"bare query": bare} if name == LATEST else {}
            _ways(report, name, calls, theirs)
        if shared.reads != "shared":
            raise SystemExit("the server's memory was not read to the end")


def _ways(report: Report, name: str, calls: Mapping[str, Call], theirs: Process | None) -> None:
    runs = {
        way: functools.partial(_trial, report, call, QUERIES if "query" in way else CALLS)
        for way, call in calls.items()
    }
    if theirs is not None and name in TF2:
        runs["tf2"] = functools.partial(trial, report, theirs, TF2[name])
    cells = {way: Cell({"case": name}, way, run=run) for way, run in runs.items()}
    for cell in cells.values():
        cell.run()  # warms up
    report.measure(list(cells.values()), report.repetitions(21))
    us = {way: cell.values("us_per_call") for way, cell in cells.items()}
    report.check(
        Target(f"{name}, {way} to {base}", limit, ratios(us[way], us[base]), at_least)
        for way, base, limit, at_least in (
            ("shared", "embedded", 1.5, False),
            ("mirror", "embedded", 1.1, False),
            ("query", "shared", 300, True),
            ("query", "bare query", 1.3, False),
        )
        if base in us
    )


@contextlib.contextmanager
def _bare_query(endpoint: str) -> Iterator[Call]:
    """An empty query with as many bytes as a lookup, of a server that does nothing else."""
    request = wire.pack(lookups.lookup_transform(TARGET, SOURCE).body())
    with connect(endpoint) as session:
        reply_bytes = ask(session, LOOKUP, request)
    with (
        listening("bench.empty_server", str(reply_bytes)) as (_, empty_endpoint),
        connect(empty_endpoint) as empty,
    ):
        yield functools.partial(ask, empty, empty_server.KEY, bytes(len(request)))


def _trial(report: Report, call: Call, calls: int) -> Trial:
    """The median of five runs, as other programs run meanwhile."""
    calls = max(1, calls // (500 if report.quick else 5))
    runs = timeit.repeat(call, number=calls, repeat=5)
    return {"us_per_call": 1e6 * statistics.median(runs) / calls}
