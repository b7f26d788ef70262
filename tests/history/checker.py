"""Is a history strictly serializable? If not: which transactions are in no possible order?

Every rule that orders two transactions is an edge of a graph, and a cycle is an anomaly:

ww  the later version of a link comes after the earlier one, where versions come in their order
wr  who reads a version comes after who wrote it
rw  who reads a version comes before all that wrote newer ones
rt  who has its answer comes before whoever asks after that

Two of these would need an edge for nearly every pair of transactions. Nodes that are no
transactions keep them few: a *gate* before each version of a link leads to its writer and to the
gate of the next version; a chain of *moments*, one after each response, carries real time.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from .history import COMMITTED, NONSENSE, OUTCOMES, Access, Column, History, Transaction

WW, WR, RW, RT = range(4)
KINDS = ("ww", "wr", "rw", "rt")
REAL_TIME = -1  # instead of a link


class PathStep(NamedTuple):
    """Transaction `before` comes before `after`."""

    before: int
    kind: int
    link: int
    after: int

    def __str__(self) -> str:
        why = "real time" if self.kind == RT else f"{KINDS[self.kind]} link {self.link}"
        return f"T{self.before} -[{why}]-> T{self.after}"


@dataclass(frozen=True)
class Anomaly:
    name: str
    transactions: list[int]
    text: str


class Edges:
    """The graph: who comes before whom, why, and over which link."""

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
    """The plainest anomaly of the history, if it has one."""
    return _unwritten(history) or _cycle(history) or _nonsense(history)


def explained(history: History, anomaly: Anomaly) -> str:
    """The anomaly, and what its transactions have done."""
    lines = [f"{anomaly.name}: {anomaly.text}"]
    start = history.transactions[:, 1].min()
    for number in sorted(set(anomaly.transactions)):
        thread, invoked, responded, outcome = Transaction(*history.transactions[number].tolist())
        lines.append(
            f"T{number}: thread {thread}, {invoked - start} to {responded - start} ns, "
            f"{OUTCOMES[outcome]}"
        )
        for row in history.accesses[history.accesses[:, 0] == number].tolist():
            _, is_write, link, stamp = Access(*row)
            lines.append(f"    {'wrote' if is_write else 'read'} link {link} as of {stamp}")
    return "\n".join(lines)


def _nonsense(history: History) -> Anomaly | None:
    for transaction in np.flatnonzero(history.transactions[:, 3] == NONSENSE):
        return Anomaly("nonsense", [int(transaction)], f"T{transaction} contradicts itself")
    return None


def _unwritten(history: History) -> Anomaly | None:
    """A version that was read, and that no other, committed transaction has written there."""
    transaction, is_write, link, stamp = history.accesses.T
    version = stamp * (link.max(initial=0) + 1) + link
    wrote = is_write == 1
    committed = wrote & (history.transactions[transaction, 3] == COMMITTED)
    by_whom = version * len(history.transactions) + transaction
    good = np.isin(version, version[committed]) & ~np.isin(by_whom, by_whom[wrote])
    for read in np.flatnonzero((stamp > 0) & ~wrote & ~good):
        reader = int(transaction[read])
        where = f"T{reader} has read link {link[read]} as of {stamp[read]}"
        writers = transaction[wrote & (version == version[read])].tolist()
        if writers and writers != [reader]:
            text = f"{where}, which T{writers[0]} wrote, which was refused"
            return Anomaly("G1a aborted read", [writers[0], reader], text)
        return Anomaly("unwritten version", [reader], f"{where}: nobody had written that")
    return None


def _cycle(history: History) -> Anomaly | None:
    graph = _graph(history)
    edges = graph.all()
    if _smallest_component(graph.nodes, edges) is None:
        return None
    # By the fewest kinds of edges that make one: that is the plainest.
    for kinds in ([WW], [WW, WR], [WW, WR, RW], [WW, WR, RW, RT]):
        some = edges[:, np.isin(edges[1], kinds)]
        component = _smallest_component(graph.nodes, some)
        if component is not None:
            within = some[:, np.isin(some[0], component) & np.isin(some[3], component)]
            steps = _shortest_cycle(within, len(history.transactions))
            break
    text = ", ".join(map(str, steps))
    return Anomaly(_name(steps), [step.before for step in steps], text)


def _graph(history: History) -> Edges:
    transactions, accesses = history.transactions, history.accesses
    graph = Edges(len(transactions))
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
    return graph


def _add_link(graph: Edges, link: int, writes: Column, reads: Column, in_order: bool) -> None:
    writers, stamps = writes[:, 0], writes[:, 3]
    gates = graph.new_nodes(len(writers))
    graph.add(gates, RW, link, writers)
    graph.add(gates[:-1], RW, link, gates[1:])
    if in_order:
        graph.add(writers[:-1], WW, link, writers[1:])

    readers = reads[:, 0]
    newer = np.searchsorted(stamps, reads[:, 3], side="right")  # the first version after it
    written = newer > 0
    graph.add(writers[newer[written] - 1], WR, link, readers[written])
    # A gate leads to all newer versions. Who wrote one of them itself goes around it: straight to
    # those in between, and to the gate after it.
    own = np.full(graph.nodes, -1)
    own[writers] = np.arange(len(writers))
    overwrites = own[readers] >= newer
    for reader, first in zip(readers[overwrites], newer[overwrites], strict=True):
        between = writers[first : own[reader]]
        graph.add(np.full(len(between), reader), RW, link, between)
    gate = np.where(overwrites, own[readers] + 1, newer)
    has_gate = gate < len(gates)
    graph.add(readers[has_gate], RW, link, gates[gate[has_gate]])


def _add_real_time(graph: Edges, transactions: Column) -> None:
    responses = np.sort(transactions[:, 2])
    moments = graph.new_nodes(len(transactions))
    graph.add(np.argsort(transactions[:, 2]), RT, REAL_TIME, moments)
    graph.add(moments[:-1], RT, REAL_TIME, moments[1:])
    before = np.searchsorted(responses, transactions[:, 1], side="left")  # answered before it asked
    after = np.flatnonzero(before > 0)
    graph.add(moments[before[after] - 1], RT, REAL_TIME, after)


def _smallest_component(nodes: int, edges: Column) -> Column | None:
    matrix = csr_array(
        (np.ones(edges.shape[1], dtype=np.int8), (edges[0], edges[3])), shape=(nodes, nodes)
    )
    _, component = connected_components(matrix, directed=True, connection="strong")
    sizes = np.bincount(component)
    if sizes.max(initial=1) == 1:
        return None
    return np.flatnonzero(component == np.argmin(np.where(sizes > 1, sizes, nodes + 1)))


def _shortest_cycle(edges: Column, transactions: int, starts: int = 64) -> list[PathStep]:
    """The shortest way from some of the transactions back to themselves."""
    after: dict[int, list[tuple[int, int, int]]] = {}
    for before, kind, link, node in edges.T.tolist():
        after.setdefault(before, []).append((kind, link, node))
    ways = (_way_back(after, start) for start in sorted(after)[:starts] if start < transactions)
    way = min(ways, key=len)
    # Steps over nodes that are no transactions are one step of their kind.
    at = [i for i, (node, _, _) in enumerate(way) if node < transactions]
    return [PathStep(way[i][0], way[i + 1][1], way[i + 1][2], way[j][0]) for i, j in pairwise(at)]


def _way_back(
    after: dict[int, list[tuple[int, int, int]]], start: int
) -> list[tuple[int, int, int]]:
    """Nodes with the kind and link of the edge that leads to each; first and last are the start."""
    came: dict[int, tuple[int, int, int]] = {}
    queue = deque([start])
    while start not in came:
        node = queue.popleft()
        for kind, link, following in after[node]:
            if following not in came:
                came[following] = (node, kind, link)
                queue.append(following)
    way: list[tuple[int, int, int]] = []
    node = start
    while not way or node != start:
        before, kind, link = came[node]
        way.append((node, kind, link))
        node = before
    return [(start, RT, REAL_TIME), *reversed(way)]


def _name(steps: list[PathStep]) -> str:
    kinds = [step.kind for step in steps]
    if RT in kinds:
        return "stale read" if RW in kinds else "order against real time"
    if RW not in kinds:
        return "G1c circular information flow" if WR in kinds else "G0 dirty write"
    if len(steps) == 2 and steps[0].link == steps[1].link and WR not in kinds:
        return "lost update"
    return "G-single read skew" if kinds.count(RW) == 1 else "G2 write skew"
