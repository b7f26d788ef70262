"""The ways of reading: an embedded tree, a server's memory, a mirror, a query; beside them a bare
Zenoh query and tf2's Python binding."""

from __future__ import annotations

import functools
import statistics
import timeit
from collections.abc import Callable, Mapping

from bench import empty_server
from bench.embedded import has_tf2, run
from bench.python_system import END_NS, PERIOD_NS, SOURCE, TARGET, history
from bench.remote import LOOKUP, SERVER, ask, connect, running
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf_client import Mirror, TransformClient, lookup_requests

Tree = TransformTree | TransformClient | Mirror
#: Between two samples, so that all links are interpolated.
AT_NS = END_NS - 100 * PERIOD_NS + PERIOD_NS // 3
QUESTIONS: dict[str, Callable[[Tree], object]] = {
    "latest common time": lambda tree: tree.lookup_transform(TARGET, SOURCE),
    "at a time": lambda tree: tree.lookup_transform(TARGET, SOURCE, AT_NS),
    "latest, atomic": lambda tree: tree.lookup_latest_transform_xact(TARGET, SOURCE),
}
#: The same lookups in tf2, by bench.python_system; it has no atomic one.
TF2 = {
    "latest common time": "lookup(TARGET, SOURCE, latest)",
    "at a time": "lookup(TARGET, SOURCE, next(times))",
}
#: Calls of one trial: of a tree in memory, and of a server.
CALLS, QUERIES = 20_000, 100


def measure(report: Report) -> None:
    """Microseconds a call of the Python API; all ways take turns, with the same answers."""
    embedded = TransformTree()
    tf2_is_there = has_tf2()
    if not tf2_is_there:
        print("no tf2 for Python (Debian: python3-tf2): no comparison")
    with (
        running(*SERVER) as (_, endpoint),
        TransformClient.connect(endpoint) as shared,
        TransformClient.connect(endpoint, reads="query") as query,
        query.mirror() as mirror,
    ):
        if shared.reads != "shared":
            raise SystemExit("the server does not share its tree")
        for parent, child, stamp_ns, *pose in history():
            stamped = StampedTransform(parent, child, stamp_ns, Transform(*pose))
            embedded.set_transform(stamped)
            shared.set_transform(stamped)
        mirror.wait_for(shared.last_receipt)
        trees: dict[str, Tree] = {"embedded": embedded, "shared": shared}
        trees |= {"mirror": mirror, "query": query}
        for name, question in QUESTIONS.items():
            answers = [question(tree) for tree in trees.values()]
            if len({repr(answer) for answer in answers}) > 1:
                raise SystemExit(f"the answers differ: {answers}")
            _ways(report, name, question, trees, TF2.get(name) if tf2_is_there else None)
        if shared.reads != "shared":
            raise SystemExit("the server's memory was not read to the end")
        _bare(report, endpoint)


def _ways(
    report: Report,
    name: str,
    question: Callable[[Tree], object],
    trees: Mapping[str, Tree],
    tf2: str | None,
) -> None:
    runs = {
        way: functools.partial(_trial, question, tree, QUERIES if way == "query" else CALLS)
        for way, tree in trees.items()
    }
    if tf2 is not None:
        runs["tf2"] = functools.partial(_tf2_trial, tf2)
    cells = {way: Cell({"case": name}, way, run=run) for way, run in runs.items()}
    for cell in cells.values():
        cell.run()  # warms up
    report.measure("reads", list(cells.values()), report.repetitions(21), baseline="embedded")
    us = {way: cell.values("us_per_call") for way, cell in cells.items()}
    targets = [
        Target(f"{name}, shared to embedded", 1.5, ratios(us["shared"], us["embedded"]), False),
        Target(f"{name}, mirror to embedded", 1.1, ratios(us["mirror"], us["embedded"]), False),
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
        trial = functools.partial(_time, call, QUERIES)
        cell = Cell({"case": "no work at all"}, "bare query", run=trial)
        cell.run()  # warms up
        report.measure("reads", [cell], report.repetitions(21))


def _trial(question: Callable[[Tree], object], tree: Tree, calls: int) -> Trial:
    return _time(functools.partial(question, tree), calls)


def _tf2_trial(statement: str) -> Trial:
    return {"us_per_call": run("tf2", statement)}


def _time(call: Callable[[], object], calls: int) -> Trial:
    """The median of five runs, as other programs run meanwhile."""
    runs = timeit.repeat(call, number=max(1, calls // 5), repeat=5)
    return {"us_per_call": 1e6 * statistics.median(runs) / max(1, calls // 5)}
