"""The service without Zenoh: message bytes in, reply bytes out.

Thread safety: all methods.
Invariant: each ReplyCallback is called exactly once; for a waiting lookup that happens later, and
on another thread.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import (
    InvalidArgumentException,
    TransformException,
)
from zenoh_tf.text import quoted

from .batches import Batch
from .clock_offsets import ClockOffsets
from .future_stamps import FutureStamps
from .info_requests import InfoRequests
from .ingest import PutCounters
from .limits import Limits
from .rate_limited_log import RateLimitedLog
from .refusals import Refusals
from .reply_cache import ReplyCache, ReplyCallback
from .request_counters import RequestCounters
from .request_guard import RequestGuard
from .state_file import Stored
from .static_links import NO_TICKET, StaticLinks, apply
from .waiters import Waiters
from .writes import Writes

if TYPE_CHECKING:
    from zenoh_tf._core import Budget, Rows

log = logging.getLogger("zenoh_tf.server")

#: Bytes of a row in a lookup's reply: status, stamp, newest stamp and pose.
_ROW_BYTES: Final = 1 + 8 + 8 + 56
#: Names that a row may use: target, source and the fixed frame.
_NAMES_PER_ROW: Final = 3


class Service:
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
    ) -> None:
        self.guard = guard or RequestGuard()
        self.tree = tree
        self.instance = instance
        self.limits = limits
        self.waiters = Waiters(tree, limits, loop)
        #: Both are filled by the ingest of puts, and read by info requests.
        self.puts = PutCounters()
        self.refusals = Refusals(limits)
        self.clocks = ClockOffsets()
        self._info = InfoRequests(tree, limits, self.refusals, self.clocks, self._counters)
        self._future = future or FutureStamps()
        self._admin_log = RateLimitedLog(log)
        self._reply_cache = ReplyCache(limits)
        self._writes = Writes(instance, self._reply_cache, self.error)
        self.name = name
        self.requests = RequestCounters()
        self._more_counters: list[Callable[[], dict[str, int]]] = []
        self._links = links or StaticLinks(tree, limits, None, Stored())
        self._identity = {
            "tree": name,
            "instance": instance,
            "server_version": version("zenoh-tf"),
            "limits": limits.as_dict(),
        }
        self._operations: dict[str, Callable[[wire.Message, ReplyCallback], None]] = {
            "lookup": self._lookup,
            "commit": self._commit,
            "batch": self._batch,
            "info": self._reply_to_info,
            "admin": self._admin,
            "hello": self._reply_to_hello,
        }

    def handle(
        self, operation: str, payload: bytes, reply_to: ReplyCallback, chunk: str | None = None
    ) -> None:
        """Reply to one request. Never raises: an error is the reply.

        `chunk` is what stands behind the operation in the query's key.
        """
        counts = self.requests.begin()
        try:
            message = self.limits.unpack(payload)
            self.guard.check(operation, chunk, message)
            self._operations[operation](message, reply_to)
        except Exception as error:
            reply_to(self.error(error), True)
        counts.end(operation)

    def error(self, error: Exception) -> bytes:
        """The bytes of the reply to a request that failed as a whole."""
        typed = self._typed(error)
        self.requests.failed(type(typed).__name__)
        return wire.pack(wire.error_reply(self.instance, typed))

    def close(self) -> None:
        self.waiters.close()

    def stats(self) -> dict[str, int]:
        """The counters of the tree and of the server; `metric_table` declares each key."""
        return self.tree.stats() | self._counters()

    def add_counters(self, counters: Callable[[], dict[str, int]]) -> None:
        """Let `stats` have the counters of another part of the server too."""
        self._more_counters.append(counters)

    def add_reads(self, reads: dict[str, Callable[[wire.Message], wire.Message]]) -> None:
        """Serve more families: each function makes the fields of a reply."""
        for operation, read in reads.items():

            def reply(message: wire.Message, reply_to: ReplyCallback, read: Any = read) -> None:
                reply_to(self._pack_within(read(message)), False)

            self._operations[operation] = reply

    def authorities(self) -> list[dict[str, Any]]:
        """The records of all authorities, with what was refused of each, and its clock."""
        return self._info.authorities()

    @staticmethod
    def _typed(error: Exception) -> TransformException:
        if not isinstance(error, (TransformException, TypeError, ValueError, OverflowError)):
            log.exception("internal error while serving a request", exc_info=error)
        return wire.as_transform_exception(error)

    def client_gone(self, client: str) -> None:
        """Release what a client holds that is not connected any more."""
        self.waiters.client_gone(client)

    def _pack(self, reply: wire.Message) -> bytes:
        reply["v"] = wire.VERSION
        reply["instance"] = self.instance
        return wire.pack(reply)

    def _pack_within(self, reply: wire.Message) -> bytes:
        """Raises LimitExceeded for more bytes than a reply may have."""
        data = self._pack(reply)
        self.limits.check("reply_bytes", len(data))
        return data

    # --- reads

    def _lookup(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        one = wire.parse_one_read(message)
        if one is not None and (found := self.read_one(*one)) is not None:
            reply_to(self._pack(found), False)
            return
        lookup = wire.parse_lookup(message)
        self.limits.check("rows", lookup.rows)
        budget = self.limits.budget()
        if not lookup.timeout_ns:
            reply_to(self._pack_within(self.read(lookup, budget)), False)
            return

        def settle(found: list[Rows]) -> None:
            reply_to(self._pack_within(wire.lookup_reply(lookup, *found[0])), False)

        self._wait([lookup], budget, settle, reply_to)

    def _wait(
        self,
        lookups: list[wire.Lookup],
        budget: Budget,
        settle: Callable[[list[Rows]], None],
        reply_to: ReplyCallback,
    ) -> None:
        def fail(error: Exception) -> None:
            reply_to(self.error(error), True)

        self.waiters.ask(lookups, reply_to.client, budget, settle, fail)

    def read_one(
        self, target: str, source: str, op: int, stamp_ns: int, budget: Budget | None = None
    ) -> wire.Message | None:
        """Fast path of a single lookup without options: the reply's fields, or None if the lookup
        fails or is of another kind. The general path then finds out why."""
        tree = self.tree
        newest_ns = None
        try:
            if budget is not None:
                budget.take_links(tree._links((target, source)) + 1)
            if op == wire.OP_AT and stamp_ns != wire.NO_STAMP:
                found = tree.lookup_transform(target, source, stamp_ns)
            elif op == wire.OP_COMMON:
                found = tree.lookup_transform(target, source)
            elif op == wire.OP_LATEST:
                found = latest = tree.lookup_latest_transform(target, source)
                newest_ns = latest.newest_stamp_ns
            elif op == wire.OP_LATEST_XACT:
                found = latest = tree.lookup_latest_transform_xact(target, source)
                newest_ns = latest.newest_stamp_ns
            else:
                return None
        except TransformException:
            return None
        return wire.one_answer(found.stamp_ns, newest_ns, found.transform.pose())

    def read(self, lookup: wire.Lookup, budget: Budget) -> wire.Message:
        """The fields of the reply to a lookup that does not wait."""
        self._check_names(lookup.names)
        budget.take_reply(_ROW_BYTES * lookup.rows)
        rows = self.tree._read_rows(
            lookup.names,
            lookup.op,
            lookup.target,
            lookup.source,
            lookup.stamp,
            lookup.fixed,
            lookup.source_stamp,
            atomic=lookup.atomic,
            versions=lookup.versions,
            errors=lookup.errors,
            budget=budget,
        )
        return wire.lookup_reply(lookup, *rows)

    # --- writes

    def _commit(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        def run(expires_ns: int) -> tuple[bytes, bytes]:
            commit = wire.parse_commit(message)
            self.limits.check("rows", commit.rows)
            stored, ticket = self.commit_reply(commit, expires_ns)
            self._links.wait(ticket)
            reply = self._pack(stored)
            return reply, reply

        self._writes.run(message, reply_to, "a transaction", run)

    def commit_reply(self, commit: wire.Commit, expires_ns: int | None) -> tuple[wire.Message, int]:
        """The fields of the reply to a commit, and the ticket of its durability."""
        self._future.check(commit)
        commit.expires_ns = expires_ns
        stored, ticket = self._store(commit)
        return wire.commit_reply(stored), ticket

    def wait_until_durable(self, ticket: int) -> None:
        """Wait for what has a ticket. Raises NotDurable."""
        self._links.wait(ticket)

    def commit(self, commit: wire.Commit, max_stamp_ns: int | None = None) -> Any:
        """Commit a put to the tree: (n,) uint8, 1 stored, 0 dropped, 2 dropped as later than
        `max_stamp_ns`. Static links are stored soon after."""
        return self._store(commit, max_stamp_ns)[0]

    def _store(self, commit: wire.Commit, max_stamp_ns: int | None = None) -> tuple[Any, int]:
        """Commit a transaction to the tree: what is stored, and the ticket of its durability."""
        self._check_names(commit.names)
        self._check_names(commit.read_names)
        if commit.static:
            return self._links.commit(commit)
        stored = apply(self.tree, commit, max_stamp_ns)
        return stored, self._links.made_dynamic(commit) if self._links.is_stored else NO_TICKET

    def _check_names(self, names: list[str]) -> None:
        """Refuse more names than the most rows can use."""
        if len(names) > _NAMES_PER_ROW * self.limits.rows:
            raise self.limits.exceeded("rows", len(names) // _NAMES_PER_ROW)

    # --- batches, info and administration

    def _batch(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        batch = Batch(message, self.limits, self.instance, self)
        if batch.commits:

            def run(expires_ns: int) -> tuple[bytes, bytes]:
                batch.run(expires_ns)
                return batch.reply(), batch.outcome()

            def repeat(outcome: bytes) -> bytes:
                batch.run_reads(outcome)
                return batch.reply()

            what = f"a batch with {batch.commits} transactions"
            self._writes.run(message, reply_to, what, run, repeat, batch.most_outcome_bytes)
            return
        batch.run(None)
        if batch.waiting:

            def settle(found: list[Rows]) -> None:
                reply_to(batch.settle(found), False)

            self._wait(list(batch.waiting.values()), batch.budget, settle, reply_to)
        else:
            reply_to(batch.reply(), False)

    def failure(self, error: Exception) -> wire.Message:
        """The error as the reply to an operation of a batch has it."""
        return {"error": wire.encode_error(self._typed(error))}

    def _reply_to_info(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        if message.get("what") == "hello":  # of a client from before this family
            self._reply_to_hello(message, reply_to)
        else:
            budget = self.limits.budget()
            reply_to(self._pack_within(self._info.reply(message, budget)), False)

    def _reply_to_hello(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        if "clock_ns" in message:
            told = wire.integer(message, "clock_ns"), wire.integer(message, "round_trip_ns", -1)
            self.clocks.client_told(reply_to.client, *told)
        reply_to(self._pack({"value": self._hello(message)}), False)

    def info(self, message: wire.Message, budget: Budget) -> wire.Message:
        """The fields of the reply to an info request."""
        if wire.text(message, "what") == "hello":
            return {"value": self._hello(message)}
        return self._info.reply(message, budget)

    def _counters(self) -> dict[str, int]:
        counters = {"outcomes": len(self._reply_cache), **self.puts.as_dict()}
        counters |= self._links.counters()
        for more in self._more_counters:
            counters |= more()
        return counters

    def _hello(self, message: wire.Message) -> dict[str, Any]:
        access = self.guard.access(message)
        known = self._identity | {"clock_ns": time.monotonic_ns()}
        return known if access is None else known | {"access": access}

    def _admin(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        def run(expires_ns: int) -> tuple[bytes, bytes]:
            self._reply_cache.expiry(expires_ns)  # again, as late as can be
            reply = self._pack(self._administer(message))
            return reply, reply

        self._writes.run(message, reply_to, "an administrative operation", run)

    def _administer(self, message: wire.Message) -> wire.Message:
        what = wire.text(message, "what")
        if what == "clear":
            ticket = self._links.clear(wire.flag(message, "keep_static", True))
            self._admin_log.info("clear", "cleared the tree")
        elif what == "reset":
            ticket = self._links.reset()
            self._admin_log.info("reset", "reset the tree: every frame is gone")
        elif what == "remove_frame":
            name = wire.name(message, "name", self.limits.name_bytes)
            ticket = self._links.remove_frame(name, wire.flag(message, "subtree"))
            self._admin_log.info("remove_frame", f"removed frame {quoted(name)}")
        else:
            raise InvalidArgumentException(f"unknown admin operation {quoted(what)}", field="what")
        self._links.wait(ticket)
        return {"value": None}
