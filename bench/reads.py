"""The ways of reading: an embedded tree, a server's memory, a query; beside a bare Zenoh query."""

from __future__ import annotations

import functools
import statistics
import timeit
from collections.abc import Callable

from bench import empty_server
from bench.python_system import END_NS, PERIOD_NS, SOURCE, TARGET, history
from bench.remote import LOOKUP, SERVER, ask, connect, running
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf_client import TransformClient, lookup_requests

#: Between two samples, so that all links are interpolated.
AT_NS = END_NS - 100 * PERIOD_NS + PERIOD_NS // 3
QUESTIONS: dict[str, Callable[[TransformTree | TransformClient], object]] = {
    "latest common time": lambda tree: tree.lookup_transform(TARGET, SOURCE),
    "at a time": lambda tree: tree.lookup_transform(TARGET, SOURCE, AT_NS),
    "latest, atomic": lambda tree: tree.lookup_latest_transform_xact(TARGET, SOURCE),
}
#: Calls of one trial: of a tree in memory, and of a server.
CALLS, QUERIES = 20_000, 100


def measure(report: Report) -> None:
    """Microseconds a call of the Python API; all ways take turns, with the same answers."""
    embedded = TransformTree()
    with (
        running(*SERVER) as (_, endpoint),
        TransformClient.connect(endpoint) as shared,
        TransformClient.connect(endpoint, reads="query") as query,
    ):
        if shared.reads != "shared":
            raise SystemExit("the server does not share its tree")
        for parent, child, stamp_ns, *pose in history():
            stamped = StampedTransform(parent, child, stamp_ns, Transform(*pose))
            embedded.set_transform(stamped)
            shared.set_transform(stamped)
        for name, question in QUESTIONS.items():
            answers = [question(tree) for tree in (embedded, shared, query)]
            if len({repr(answer) for answer in answers}) > 1:
                raise SystemExit(f"the answers differ: {answers}")
            _ways(report, name, question, embedded, shared, query)
        _bare(report, endpoint)


def _ways(
    report: Report,
    name: str,
    question: Callable[[TransformTree | TransformClient], object],
    embedded: TransformTree,
    shared: TransformClient,
    query: TransformClient,
) -> None:
    ways: dict[str, tuple[TransformTree | TransformClient, int]] = {
        "embedded": (embedded, CALLS),
        "shared": (shared, CALLS),
        "query": (query, QUERIES),
    }
    cells = {
        way: Cell({"case": name}, way, run=functools.partial(_trial, question, tree, calls))
        for way, (tree, calls) in ways.items()
    }
    for cell in cells.values():
        cell.run()  # warms up
    report.measure("reads", list(cells.values()), report.repetitions(21), baseline="embedded")
    if shared.reads != "shared":
        raise SystemExit("the server's memory was not read to the end")
    us = {way: cell.values("us_per_call") for way, cell in cells.items()}
    targets = [
        Target(f"{name}, shared to embedded", 1.5, ratios(us["shared"], us["embedded"]), False),
        Target(f"{name}, query to shared", 300, ratios(us["query"], us["shared"])),
    ]
    report.check("reads", targets)


def _bare(report: Report, endpoint: str) -> None:
    """An empty query of as many bytes as a lookup."""
    request = wire.pack(lookup_requests.lookup_transform(TARGET, SOURCE).body())
    with connect(endpoint) as session:
        reply_bytes = ask(session, LOOKUP, request)
    with (
        running("bench.empty_server", str(reply_bytes)) as (_, empty_endpoint),
        connect(empty_endpoint) as empty,
    ):
        call = functools.partial(ask, empty, empty_server.KEY, bytes(len(request)))
        run = functools.partial(_time, call, QUERIES)
        cell = Cell({"case": "no work at all"}, "bare query", run=run)
        cell.run()  # warms up
        report.measure("reads", [cell], report.repetitions(21))


def _trial(
    question: Callable[[TransformTree | TransformClient], object],
    tree: TransformTree | TransformClient,
    calls: int,
) -> Trial:
    return _time(functools.partial(question, tree), calls)


def _time(call: Callable[[], object], calls: int) -> Trial:
    """The median of five runs, as other programs run meanwhile."""
    runs = timeit.repeat(call, number=max(1, calls // 5), repeat=5)
    return {"us_per_call": 1e6 * statistics.median(runs) / max(1, calls // 5)}
