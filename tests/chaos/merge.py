"""Makes one history of the files of all clients, over all servers that have held the tree.

A server without state starts empty, so its links are links of their own: the number of a link in
the history holds the epoch of its server. Link 0 carries the epochs themselves: each new server
writes it once and every read reads it, so that an answer of a dead server is a stale read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.history.history import COMMITTED, CONFLICT, FROM_A_MIRROR, INCONSISTENT, History

from . import links
from .client import TIMEOUT_S

_NEVER_NS = 1 << 62


@dataclass
class _Call:
    """One transaction of one client."""

    client: int
    invoked_ns: int
    responded_ns: int
    outcome: str
    version: int = 0  # that it writes; 0: none
    written: list[int] = field(default_factory=list)
    reads: list[tuple[int, int, links.Seen]] = field(default_factory=list)
    kind: str = ""  # of reads that it could use
    waited: bool = False  # for its own write, where it reads
    is_copy: bool = False  # it read a mirror or a replica, which may be old


@dataclass
class Start:
    """A new server whose tree was made."""

    epoch: int
    invoked_ns: int
    responded_ns: int


@dataclass
class Merged:
    history: History
    outcomes: dict[str, int]  # how many transactions had each
    complaints: list[str]  # what clients themselves found inconsistent
    kinds: dict[str, int]  # how many committed transactions could use which kind of read


def link_number(epoch: int, link: int) -> int:
    return 1 + (epoch - 1) * links.LINKS + link


def merge(files: list[Path], starts: list[Start]) -> Merged:
    """The history of all clients. Calls without an answer count as committed if any read saw
    what they wrote, and until their expiry; otherwise they count as never run."""
    calls = [call for client, path in enumerate(files) for call in _calls(client, path)]
    seen_in = _epochs_of_versions(calls)
    builder = _Builder()
    for start in starts:
        accesses = [(0, start.epoch), *((link_number(start.epoch, i), 1) for i in _all_links())]
        builder.add(-1, start.invoked_ns, start.responded_ns, COMMITTED, [], accesses)
    outcomes: dict[str, int] = {}
    complaints = []
    kinds: dict[str, int] = {}
    for call in calls:
        outcome = call.outcome
        if outcome.startswith("inconsistent"):
            complaints.append(f"client {call.client}: {outcome}")
            outcome = "inconsistent"
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
        if call.kind and outcome == "committed":
            kinds[call.kind] = kinds.get(call.kind, 0) + 1
        _add(builder, call, outcome, seen_in)
    return Merged(builder.history(), outcomes, complaints, kinds)


def _all_links() -> range:
    return range(links.LINKS)


def _calls(client: int, path: Path) -> Iterator[_Call]:
    begun: dict[str, Any] | None = None
    for line in path.read_text().splitlines():
        record = json.loads(line)
        if "invoked" in record:
            if begun:  # an earlier process of this file was killed
                yield _open(client, begun)
            begun = record
            continue
        assert begun is not None
        reads = [
            (before, after, links.Seen(seen[0], {int(k): v for k, v in seen[1].items()}))
            for before, after, seen in record["reads"]
        ]
        yield _Call(
            client,
            begun["invoked"],
            record["responded"],
            record["outcome"],
            begun["version"],
            begun["written"],
            reads,
            record.get("kind", ""),
            record.get("waited", False),
            record.get("is_copy", False),
        )
        begun = None
    if begun:
        yield _open(client, begun)


def _open(client: int, begun: dict[str, Any]) -> _Call:
    return _Call(client, begun["invoked"], _NEVER_NS, "open", begun["version"], begun["written"])


def _epochs_of_versions(calls: list[_Call]) -> dict[tuple[int, int], int]:
    """By link and version that a read saw: the epoch in which it saw it."""
    found: dict[tuple[int, int], int] = {}
    for call in calls:
        for _, _, seen in call.reads:
            found.update((item, seen.epoch) for item in seen.versions.items())
    return found


class _Builder:
    def __init__(self) -> None:
        self._transactions: list[tuple[int, int, int, int]] = []
        self._accesses: list[tuple[int, int, int, int]] = []

    @staticmethod
    def follower(client: int) -> int:
        """The thread of a client's mirror."""
        return -2 - client

    def add(
        self,
        thread: int,
        invoked_ns: int,
        responded_ns: int,
        outcome: int,
        reads: list[links.Seen],
        writes: list[tuple[int, int]],
    ) -> None:
        number = len(self._transactions)
        self._transactions.append((thread, invoked_ns, responded_ns, outcome))
        read = {(0, seen.epoch) for seen in reads}
        for seen in reads:
            read |= {(link_number(seen.epoch, link), v) for link, v in seen.versions.items()}
        self._accesses += [(number, 0, *item) for item in sorted(read)]
        self._accesses += [(number, 1, *item) for item in writes]

    def history(self) -> History:
        return History(
            np.array(self._transactions, dtype=np.int64).reshape(-1, 4),
            np.array(self._accesses, dtype=np.int64).reshape(-1, 4),
            in_order=False,  # late stamps are stored behind newer ones
        )


def _add(builder: _Builder, call: _Call, outcome: str, seen_in: dict[tuple[int, int], int]) -> None:
    reads = [seen for _, _, seen in call.reads]
    epochs = {seen.epoch for seen in reads}
    if call.is_copy and outcome == "committed":
        # The checker puts it behind the transaction before it of its thread. Those are its earlier
        # reads and the writes that it has waited for: all others get another thread.
        builder.add(
            builder.follower(call.client), FROM_A_MIRROR, call.responded_ns, COMMITTED, reads, []
        )
        return
    if outcome == "inconsistent":
        builder.add(call.client, call.invoked_ns, call.responded_ns, INCONSISTENT, [], [])
        return
    keys = ((link, call.version) for link in call.written)
    epoch = next(iter(epochs), None) or next((seen_in[k] for k in keys if k in seen_in), None)
    if outcome == "committed":
        if call.version and epoch is None:
            return  # it read nothing and no read saw it, so its server is not known
        writes = _writes(call, epoch) if call.version and epoch else []
        thread = builder.follower(call.client) if call.waited else call.client
        builder.add(thread, call.invoked_ns, call.responded_ns, COMMITTED, reads, writes)
        return
    if outcome in ("unknown", "open") and call.version:
        was_seen = any((link, call.version) in seen_in for link in call.written)
        if epoch is not None and was_seen:
            # The last possible expiry: the write began before the client gave up.
            until_ns = min(_NEVER_NS, call.responded_ns + int(TIMEOUT_S * 1e9))
            writes = _writes(call, epoch)
            builder.add(call.client, call.invoked_ns, until_ns, COMMITTED, reads, writes)
            return
    # It did not commit, so its reads need not be one snapshot: each is a transaction of its own.
    for before_ns, after_ns, seen in call.reads:
        builder.add(call.client, before_ns, after_ns, CONFLICT, [seen], [])
    if (outcome == "conflict" or outcome.startswith("failed")) and call.version:
        # Its writes must not be seen in any epoch; the one it was meant for stands for all.
        for key in ((link, call.version) for link in call.written):
            epoch = seen_in.get(key, next(iter(epochs), None))
            if epoch is not None:
                item = [(link_number(epoch, key[0]), key[1])]
                builder.add(call.client, call.invoked_ns, call.responded_ns, CONFLICT, [], item)


def _writes(call: _Call, epoch: int) -> list[tuple[int, int]]:
    return [(link_number(epoch, link), call.version) for link in call.written]
