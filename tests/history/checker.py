"""Decides whether a history is strictly serializable, and names the transactions that are not.

Every rule that orders two transactions is an edge of a dependency graph. A cycle is an anomaly.

ww  a later version of a link follows the earlier one, if versions are written in stamp order
wr  a transaction that reads a version follows the one that wrote it
rw  a transaction that reads a version precedes all that wrote newer ones
rt  a transaction precedes every one that started after it had ended (real time)
so  a transaction precedes the next one of its thread if that reads a mirror (session order)

A transaction that reads a mirror has started at no known time, so that it may be old: it is only
where its thread was before, or later.

The rules rw and rt would need an edge for nearly every pair of transactions. Auxiliary nodes keep
the graph small: a *gate* before each version of a link leads to its writer and to the next gate,
and a chain of *time nodes*, one after each response, carries real time.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from .history import (
    COMMITTED,
    FROM_A_MIRROR,
    INCONSISTENT,
    OUTCOMES,
    Access,
    Column,
    History,
    Transaction,
)

WW, WR, RW, RT, SO = range(5)
KINDS = ("ww", "wr", "rw", "rt", "so")
NO_LINK = -1  # the link of an edge of real time or of a session


class Dependency(NamedTuple):
    """An edge: transaction `before` precedes transaction `after`."""

    before: int
    kind: int
    link: int
    after: int

    def __str__(self) -> str:
        why = {RT: "real time", SO: "session"}.get(
            self.kind, f"{KINDS[self.kind]} link {self.link}"
        )
        return f"T{self.before} -[{why}]-> T{self.after}"


@dataclass(frozen=True)
class Anomaly:
    name: str
    transactions: list[int]
    text: str


class DependencyGraph:
    """Edges from a node to a later one, each with its kind and its link."""

    def __init__(self, nodes: int) -> None:
        self.nodes = nodes
        self._parts: list[Column] = []

    def new_nodes(self, n: int) -> Column:
        self.nodes += n
        return np.arange(self.nodes - n, self.nodes)

    def add(self, before: Column, kind: int, link: int, after: Column) -> None:
        part = np.empty((4, len(before)), dtype=np.int64)
        part[0], part[1], part[2], part[3] = before, kind, link, after
        self._parts.append(part[:, before != after])

    def all(self) -> Column:
        return np.concatenate(self._parts, axis=1)


def find_anomaly(history: History) -> Anomaly | None:
    """Return the simplest anomaly of the history, or None if it is strictly serializable."""
    return _unwritten(history) or _cycle(history) or _inconsistent(history)


def describe(history: History, anomaly: Anomaly) -> str:
    """Return the anomaly and what each of its transactions read and wrote."""
    lines = [f"{anomaly.name}: {anomaly.text}"]
    invoked_ns = history.transactions[:, 1]
    start = invoked_ns[invoked_ns != FROM_A_MIRROR].min(initial=history.transactions[0, 2])
    for number in sorted(set(anomaly.transactions)):
        thread, invoked, responded, outcome = Transaction(*history.transactions[number].tolist())
        called = "from a mirror" if invoked == FROM_A_MIRROR else f"{invoked - start}"
        lines.append(
            f"T{number}: thread {thread}, {called} to {responded - start} ns, {OUTCOMES[outcome]}"
        )
        for row in history.accesses[history.accesses[:, 0] == number].tolist():
            _, is_write, link, stamp = Access(*row)
            lines.append(f"    {'wrote' if is_write else 'read'} link {link} at stamp {stamp}")
    return "\n".join(lines)


def _inconsistent(history: History) -> Anomaly | None:
    for transaction in np.flatnonzero(history.transactions[:, 3] == INCONSISTENT):
        return Anomaly(
            "inconsistent result",
            [int(transaction)],
            f"T{transaction} returned an inconsistent result",
        )
    return None


def _unwritten(history: History) -> Anomaly | None:
    """Find a read of a version that no other committed transaction wrote."""
    transaction, is_write, link, stamp = history.accesses.T
    version = stamp * (link.max(initial=0) + 1) + link
    wrote = is_write == 1
    committed = wrote & (history.transactions[transaction, 3] == COMMITTED)
    version_by_writer = version * len(history.transactions) + transaction
    good = np.isin(version, version[committed]) & ~np.isin(
        version_by_writer, version_by_writer[wrote]
    )
    for read in np.flatnonzero((stamp > 0) & ~wrote & ~good):
        reader = int(transaction[read])
        where = f"T{reader} read link {link[read]} at stamp {stamp[read]}"
        writers = transaction[wrote & (version == version[read])].tolist()
        if writers and writers != [reader]:
            text = f"{where}, written by T{writers[0]}, which was rejected"
            return Anomaly("G1a aborted read", [writers[0], reader], text)
        return Anomaly("unwritten version", [reader], f"{where}, which no transaction wrote")
    return None


def _cycle(history: History) -> Anomaly | None:
    graph = _graph(history)
    edges = graph.all()
    if _smallest_component(graph.nodes, edges) is None:
        return None
    # A cycle of fewer kinds of edges is the simpler anomaly.
    for kinds in ([WW], [WW, WR], [WW, WR, RW], range(4), range(5)):
        some = edges[:, np.isin(edges[1], list(kinds))]
        component = _smallest_component(graph.nodes, some)
        if component is not None:
            within = some[:, np.isin(some[0], component) & np.isin(some[3], component)]
            steps = _shortest_cycle(within, len(history.transactions))
            break
    text = ", ".join(map(str, steps))
    return Anomaly(_name(steps), [step.before for step in steps], text)


def _graph(history: History) -> DependencyGraph:
    transactions, accesses = history.transactions, history.accesses
    graph = DependencyGraph(len(transactions))
    wrote = (accesses[:, 1] == 1) & (transactions[accesses[:, 0], 3] == COMMITTED)
    for link in np.unique(accesses[:, 2]):
        here = accesses[:, 2] == link
        writes = accesses[wrote & here]
        _add_link(
            graph,
            int(link),
            writes[np.argsort(writes[:, 3])],
            accesses[here & (accesses[:, 1] == 0)],
            history.in_order,
        )
    _add_real_time(graph, transactions)
    _add_sessions(graph, transactions)
    return graph


def _add_link(
    graph: DependencyGraph, link: int, writes: Column, reads: Column, in_order: bool
) -> None:
    writers, stamps = writes[:, 0], writes[:, 3]
    gates = graph.new_nodes(len(writers))
    graph.add(gates, RW, link, writers)
    graph.add(gates[:-1], RW, link, gates[1:])
    if in_order:
        graph.add(writers[:-1], WW, link, writers[1:])

    readers = reads[:, 0]
    newer = np.searchsorted(stamps, reads[:, 3], side="right")  # the first newer version
    written = newer > 0
    graph.add(writers[newer[written] - 1], WR, link, readers[written])
    # A gate leads to all newer versions. A reader that wrote one of them itself must not precede
    # itself: it gets edges to the versions in between and to the gate after its own version.
    own = np.full(graph.nodes, -1)
    own[writers] = np.arange(len(writers))
    overwrites = own[readers] >= newer
    for reader, first in zip(readers[overwrites], newer[overwrites], strict=True):
        between = writers[first : own[reader]]
        graph.add(np.full(len(between), reader), RW, link, between)
    gate = np.where(overwrites, own[readers] + 1, newer)
    has_gate = gate < len(gates)
    graph.add(readers[has_gate], RW, link, gates[gate[has_gate]])


def _add_real_time(graph: DependencyGraph, transactions: Column) -> None:
    responses = np.sort(transactions[:, 2])
    time_nodes = graph.new_nodes(len(transactions))
    graph.add(np.argsort(transactions[:, 2]), RT, NO_LINK, time_nodes)
    graph.add(time_nodes[:-1], RT, NO_LINK, time_nodes[1:])
    before = np.searchsorted(
        responses, transactions[:, 1], side="left"
    )  # responses before the call
    after = np.flatnonzero(before > 0)
    graph.add(time_nodes[before[after] - 1], RT, NO_LINK, after)


def _add_sessions(graph: DependencyGraph, transactions: Column) -> None:
    order = np.argsort(transactions[:, 0], kind="stable")  # within a thread, as they were run
    before, after = order[:-1], order[1:]
    is_next = transactions[before, 0] == transactions[after, 0]
    is_next &= transactions[after, 1] == FROM_A_MIRROR
    graph.add(before[is_next], SO, NO_LINK, after[is_next])


def _smallest_component(nodes: int, edges: Column) -> Column | None:
    matrix = csr_array(
        (np.ones(edges.shape[1], dtype=np.int8), (edges[0], edges[3])), shape=(nodes, nodes)
    )
    _, component = connected_components(matrix, directed=True, connection="strong")
    sizes = np.bincount(component)
    if sizes.max(initial=1) == 1:
        return None
    return np.flatnonzero(component == np.argmin(np.where(sizes > 1, sizes, nodes + 1)))


def _shortest_cycle(edges: Column, transactions: int, starts: int = 64) -> list[Dependency]:
    """Return the shortest cycle through any of the first `starts` transactions."""
    after: dict[int, list[tuple[int, int, int]]] = {}
    for before, kind, link, node in edges.T.tolist():
        after.setdefault(before, []).append((kind, link, node))
    paths = (_path_back(after, start) for start in sorted(after)[:starts] if start < transactions)
    path = min(paths, key=len)
    # Edges over auxiliary nodes count as one edge of their kind.
    at = [i for i, (node, _, _) in enumerate(path) if node < transactions]
    return [
        Dependency(path[i][0], path[i + 1][1], path[i + 1][2], path[j][0]) for i, j in pairwise(at)
    ]


def _path_back(
    after: dict[int, list[tuple[int, int, int]]], start: int
) -> list[tuple[int, int, int]]:
    """Return the nodes of a cycle, each with kind and link of its incoming edge (breadth first)."""
    incoming: dict[int, tuple[int, int, int]] = {}
    queue = deque([start])
    while start not in incoming:
        node = queue.popleft()
        for kind, link, following in after[node]:
            if following not in incoming:
                incoming[following] = (node, kind, link)
                queue.append(following)
    path: list[tuple[int, int, int]] = []
    node = start
    while not path or node != start:
        before, kind, link = incoming[node]
        path.append((node, kind, link))
        node = before
    return [(start, RT, NO_LINK), *reversed(path)]


def _name(steps: list[Dependency]) -> str:
    kinds = [step.kind for step in steps]
    if SO in kinds:
        return "a session goes back"
    if RT in kinds:
        return "stale read" if RW in kinds else "order against real time"
    if RW not in kinds:
        return "G1c circular information flow" if WR in kinds else "G0 dirty write"
    if len(steps) == 2 and steps[0].link == steps[1].link and WR not in kinds:
        return "lost update"
    return "G-single read skew" if kinds.count(RW) == 1 else "G2 write skew"
