"""The service without Zenoh: message bytes in, reply bytes out.

Thread safety: all methods.
Invariant: each ReplyCallback is called exactly once; for a waiting lookup that happens later, and
on another thread.
"""

from __future__ import annotations

import asyncio
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from itertools import groupby
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from zenoh_tf import TransformTree, admission, wire
from zenoh_tf._core import reply_to_lookup
from zenoh_tf._net import handover
from zenoh_tf.errors import TransactionConflict, TransformException

from ..ingest.clock_offsets import ClockOffsets
from ..ingest.future_stamps import FutureStamps
from ..ingest.put_commits import Outcome, PutCounters
from ..ingest.refusals import Refusals
from ..limits import NAMES_PER_ROW, Limits
from ..state.file import Stored
from ..state.static_links import NO_STATE_WRITE, StaticLinks
from .admin import AdminRequests
from .batches import BatchRun
from .guard import RequestGuard
from .handler import Handler, ReplyCallback, ReplyWithField
from .info import InfoRequests
from .reads import LookupRequests
from .surroundings import ALONE, Surroundings
from .waiters import Waiters
from .writes import WriteOutcomes

if TYPE_CHECKING:
    from zenoh_tf._core import Budget, Rows


class Service(Handler):
    """Serves the requests of one tree; see the module."""

    def __init__(
        self,
        tree: TransformTree,
        name: str,
        instance: str,
        limits: Limits,
        loop: asyncio.AbstractEventLoop,
        links: StaticLinks | None = None,
        guard: RequestGuard | None = None,
        future: FutureStamps | None = None,
        around: Surroundings = ALONE,
    ) -> None:
        super().__init__(name, limits, guard or RequestGuard())
        self.tree = tree
        self._instance = instance
        self.waiters = Waiters(tree, limits, loop, around.is_connected)
        self.reads = LookupRequests(tree, limits)
        #: Both are filled by the ingest of puts, and read by info requests.
        self.puts = PutCounters()
        self.refusals = Refusals(limits)
        self.clocks = ClockOffsets()
        counters = _counters_of(self)
        self.info_requests = InfoRequests(
            tree, limits, self.refusals, self.clocks, counters, around
        )
        self._future = future or FutureStamps()
        self._refused_ahead_ns = self._future.refused_ahead_ns
        self._writes = WriteOutcomes(instance, limits)
        self._last_seq = around.last_seq
        self._on_commit = around.on_commit
        self._offer = around.offer
        self.links = links or StaticLinks(tree, limits, None, Stored())
        self._admin_requests = AdminRequests(self.links, limits, self.refusals)
        self._identity = {
            "tree": name,
            "instance": instance,
            "server_version": version("zenoh-tf"),
            "limits": limits.as_dict(),
            **around.identity,
        }
        # Functions, not bound methods: nothing in the service may refer to it. A replica's copy
        # that was replaced then goes at once with its memory, not when garbage is collected.
        self._handlers: dict[str, Callable[[Service, wire.Message, ReplyCallback], None]] = {
            "lookup": Service._lookup,
            "commit": type(self)._commit,
            "batch": type(self)._batch,
            "info": Service._reply_to_info,
            "admin": type(self)._admin,
            "hello": Service._reply_to_hello,
            **{request_type: _handler_of(read) for request_type, read in around.reads.items()},
        }

    @property
    def instance(self) -> str:
        return self._instance

    def handle(
        self, request_type: str, payload: bytes, reply_to: ReplyCallback, chunk: str | None = None
    ) -> None:
        begun_ns = time.perf_counter_ns()
        if request_type == "lookup":
            reply = reply_to_lookup(self.tree, payload, self._instance)
            if reply is not None:  # the common case
                reply_to(reply, False)
                self.requests.served(request_type, begun_ns)
                return
        counts = self.requests.begin(begun_ns)
        try:
            limits = self.limits
            message = wire.unpack(
                payload, limits.message_bytes, limits.decoded_bytes, request_type == "batch"
            )
            if request_type in self.guard.checked:
                self.guard.check(request_type, chunk, message)
            if wire.FLOOR in message:
                self.check_floor(*wire.take_floor(message))
                if self._last_seq is not None:
                    reply_to = ReplyWithField(reply_to, "seq", self._last_seq)
            self._handlers[request_type](self, message, reply_to)
        except Exception as error:
            reply_to(self.error(error), True)
        counts.end(request_type)

    def check_floor(self, instance: str, seq: int) -> None:
        """Check that a request sees a commit; a server that commits itself always has it. Raises
        ServerBusy."""

    def _error_reply(self, error: TransformException) -> wire.Message:
        reply = super()._error_reply(error)
        return self._add_seq(reply) if isinstance(error, TransactionConflict) else reply

    def close(self) -> None:
        self.waiters.close()

    def stats(self) -> dict[str, int]:
        return self.tree.stats() | self._counters()

    def client_gone(self, client: str) -> None:
        self.waiters.client_gone(client)
        self.clocks.client_gone(client)

    def _pack(self, reply: wire.Message) -> bytes:
        reply["v"] = wire.VERSION
        reply["instance"] = self._instance
        return wire.pack_in_steps(reply)

    def _pack_within(self, reply: wire.Message) -> bytes:
        """Raises LimitExceeded for more bytes than a reply may have."""
        data = self._pack(reply)
        self.limits.check("reply_bytes", len(data))
        return data

    # --- reads

    def _lookup(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        lookup = wire.parse_lookup(message)
        self.limits.check("rows", lookup.rows)
        budget = self.limits.budget()
        if not lookup.timeout_ns:
            reply_to(self._pack_within(self.reads.rows(lookup, budget)), False)
            return

        def settle(found: list[Rows]) -> None:
            reply_to(self._pack_within(wire.lookup_reply(lookup, *found[0])), False)

        self._wait(message, [lookup], budget, settle, reply_to)

    def _wait(
        self,
        message: wire.Message,
        lookups: list[wire.Lookup],
        budget: Budget,
        settle: Callable[[list[Rows]], None],
        reply_to: ReplyCallback,
    ) -> None:
        def fail(error: Exception) -> None:
            reply_to(self.error(error), True)

        wait_id = wire.integer(message, "wait_id") if "wait_id" in message else None
        self.waiters.ask(lookups, reply_to.client, budget, settle, fail, wait_id)

    def _cancel(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        wait_ids = wire.column(message, "wait_ids", wire.I64)
        self.limits.check("rows", wait_ids.size)
        missed = self.waiters.cancel(reply_to.client, wait_ids.tolist())
        reply_to(self._pack({"value": missed}), False)

    # --- writes

    def _commit(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        def run(expires_ns: int) -> tuple[bytes, bytes]:
            commit = wire.parse_commit(message)
            if (rows := len(commit.rows)) > self.limits.rows:
                raise self.limits.exceeded("rows", rows)
            stored, state_write = self.run_commit(commit, expires_ns)
            if state_write != NO_STATE_WRITE:
                self.links.wait(state_write)
            reply = self._pack(stored)
            return reply, reply

        self._writes.run(message, reply_to, self.error, "a transaction", run)

    def run_commit(self, commit: wire.Commit, expires_ns: int | None) -> tuple[wire.Message, int]:
        """Run a call's transaction: the fields of its reply, and the number of its state write."""
        ahead_ns = self._refused_ahead_ns
        if ahead_ns is not None and commit.rows.newest_stamp > time.time_ns() + ahead_ns:
            self._future.check(commit)
        commit.expires_ns = expires_ns
        if max(commit.rows.name_count, len(commit.read_names)) > NAMES_PER_ROW * self.limits.rows:
            self.limits.check_names(commit.rows.name_count)
            self.limits.check_names(len(commit.read_names))
        if commit.static:
            stored, state_write = self.links.commit(commit, by_call=True)
        else:
            stored = commit.apply(self.tree)
            state_write = self._committed(commit, stored)
        return self._add_seq({"stored": stored}), state_write

    def _add_seq(self, reply: wire.Message) -> wire.Message:
        """Add a number that is not below that of the write, or of what it was in conflict with."""
        if self._last_seq is not None:
            reply["seq"] = self._last_seq()
        return reply

    def commit_puts(self, puts: Sequence[wire.Commit]) -> list[Outcome]:
        """Commit puts to the tree in their order, each as a transaction of its own. Static links
        are stored soon after."""
        outcomes: list[Outcome] = []
        for is_static, together in groupby(puts, key=attrgetter("static")):
            if is_static:
                outcomes += map(self._commit_static_put, together)
            else:
                outcomes += self._commit_dynamic_puts(list(together))
        return outcomes

    def _commit_static_put(self, put: wire.Commit) -> Outcome:
        try:
            stored, _ = self.links.commit(put, by_call=False)
        except Exception as error:
            return error
        return self._outcome(put, stored)

    def _outcome(self, put: wire.Commit, stored: bytes) -> Outcome:
        if stored.count(admission.STORED) == len(stored):
            return None
        return admission.refused(self.tree, put.rows, stored) or stored

    def _commit_dynamic_puts(self, puts: list[wire.Commit]) -> list[Outcome]:
        rows, authorities, max_stamps_ns, drop_strays = [], [], [], []
        for put in puts:
            rows.append(put.rows)
            authorities.append(put.authority)
            max_stamps_ns.append(put.max_stamp_ns)
            drop_strays.append(put.drop_strays)
        stored = self.tree._commit_puts(rows, authorities, max_stamps_ns, drop_strays)
        is_followed = self._on_commit is not None or self.links.has_state_file
        outcomes: list[Outcome] = []
        for put, found in zip(puts, stored, strict=True):
            if is_followed and not isinstance(found, Exception):
                self._committed(put, found or b"\1" * len(put.rows))
            outcomes.append(self._outcome(put, found) if isinstance(found, bytes) else found)
        return outcomes

    def _committed(self, commit: wire.Commit, stored: bytes) -> int:
        """Follow a dynamic commit that the tree has applied. Returns the number of its state
        write."""
        if self._on_commit is not None:
            self._on_commit(commit, stored)
        return self.links.made_dynamic(commit) if self.links.has_state_file else NO_STATE_WRITE

    # --- batches, info and administration

    def _batch(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        batch = BatchRun(self, message)
        if batch.commits:

            def run(expires_ns: int) -> tuple[bytes, bytes]:
                batch.run(expires_ns)
                return batch.reply(), batch.outcome()

            def repeat(outcome: bytes) -> bytes:
                batch.run_reads(outcome)
                return batch.reply()

            what = f"a batch with {batch.commits} transactions"
            reserve = batch.most_outcome_bytes
            self._writes.run(message, reply_to, self.error, what, run, repeat, reserve)
            return
        batch.run(None)
        if batch.waiting:

            def settle(found: list[Rows]) -> None:
                reply_to(batch.settle(found), False)

            self._wait(message, list(batch.waiting.values()), batch.budget, settle, reply_to)
        else:
            reply_to(batch.reply(), False)

    def _reply_to_info(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        what = message.get("what")
        if what == "cancel":
            self._cancel(message, reply_to)
        else:
            budget = self.limits.budget()
            reply_to(self._pack_within(self.info_requests.reply(message, budget)), False)

    def _reply_to_hello(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        if "clock_ns" in message:
            fields = (("clock_ns", None), ("round_trip_ns", -1), ("round_trip_of_ns", -1))
            clock = [wire.integer(message, name, default) for name, default in fields]
            self.clocks.add_client_clock(reply_to.client, *clock)
        reply_to(self._pack({"value": self._hello(message)}), False)

    def info(self, message: wire.Message, budget: Budget) -> wire.Message:
        """The fields of the reply to an info request."""
        if wire.text(message, "what") == "hello":
            return {"value": self._hello(message)}
        return self.info_requests.reply(message, budget)

    def _counters(self) -> dict[str, int]:
        counters = {"outcomes": len(self._writes), **asdict(self.puts)}
        counters |= self.refusals.counters()
        return counters | self.links.counters() | self._added_counters()

    def _hello(self, message: wire.Message) -> dict[str, Any]:
        access = self.guard.access(message)
        clock_ns, real_ns = self._clocks_now()
        known = self._identity | {"clock_ns": clock_ns, "real_ns": real_ns}
        if self._last_seq is not None:
            known["seq"] = self._last_seq()
        if self._offer is not None and (access is None or "read" in access["may"]):
            known[handover.HELLO_FIELD] = self._offer.fields()
        return known if access is None else known | {"access": access}

    def _clocks_now(self) -> tuple[int, int]:
        """The clock of numbers and ages, and the real-time clock, at the same time."""
        return time.monotonic_ns(), time.time_ns()

    def _admin(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        def run(expires_ns: int) -> tuple[bytes, bytes]:
            reply = self._pack(self._add_seq(self._admin_requests.run(message, expires_ns)))
            return reply, reply

        self._writes.run(message, reply_to, self.error, "an administrative operation", run)


def _counters_of(service: Service) -> Callable[[], dict[str, int]]:
    """The counters of a service, which this does not keep alive; none once it is gone."""
    weak = weakref.ref(service)

    def counters() -> dict[str, int]:
        found = weak()
        return {} if found is None else found._counters()

    return counters


def _handler_of(
    read: Callable[[wire.Message, str], wire.Message],
) -> Callable[[Service, wire.Message, ReplyCallback], None]:
    """The handler of a request whose reply has the fields that `read` makes."""

    def reply(service: Service, message: wire.Message, reply_to: ReplyCallback) -> None:
        reply_to(service._pack_within(read(message, reply_to.client)), False)

    return reply
