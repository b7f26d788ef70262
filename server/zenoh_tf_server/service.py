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
from typing import TYPE_CHECKING, Any

from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import (
    InvalidArgumentException,
    NotDurable,
    ServerRestarted,
    TimeoutException,
    TransformException,
)
from zenoh_tf.text import quoted

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

if TYPE_CHECKING:
    from zenoh_tf._core import Rows

log = logging.getLogger("zenoh_tf.server")


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
        self._info = InfoRequests(tree, self.refusals, self.clocks, self._counters)
        self._future = future or FutureStamps()
        self._admin_log = RateLimitedLog(log)
        self._reply_cache = ReplyCache(limits)
        self.name = name
        self.requests = RequestCounters()
        self._more_counters: list[Callable[[], dict[str, int]]] = []
        self._links = links or StaticLinks(tree, limits, None, Stored())
        self._operations: dict[str, Callable[[wire.Message, ReplyCallback], None]] = {
            "lookup": self._lookup,
            "commit": lambda message, reply_to: self._write(message, reply_to, self._run_commit),
            "batch": self._batch,
            "info": self._reply_to_info,
            "admin": lambda message, reply_to: self._write(message, reply_to, self._run_admin),
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
            message = wire.unpack(payload, self.limits.message_bytes)
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

    def authorities(self) -> list[dict[str, Any]]:
        """The records of all authorities, with what was refused of each."""
        return self.refusals.add_to(self.tree._authority_records())

    @staticmethod
    def _typed(error: Exception) -> TransformException:
        if not isinstance(error, (TransformException, TypeError, ValueError, OverflowError)):
            log.exception("internal error while serving a request", exc_info=error)
        return wire.as_transform_exception(error)

    def _pack(self, reply: wire.Message) -> bytes:
        reply["v"] = wire.VERSION
        reply["instance"] = self.instance
        return wire.pack(reply)

    # --- reads

    def _lookup(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        one = wire.parse_one_read(message)
        if one is not None and (found := self._read_one(*one)) is not None:
            reply_to(self._pack(found), False)
            return
        lookup = wire.parse_lookup(message)
        self.limits.check("rows", lookup.rows)
        if lookup.timeout_ns:

            def settle(found: list[Rows]) -> None:
                reply_to(self._pack(wire.lookup_reply(lookup, *found[0])), False)

            self._wait([lookup], settle, reply_to)
        else:
            reply_to(self._pack(self._read(lookup)), False)

    def _wait(
        self,
        lookups: list[wire.Lookup],
        settle: Callable[[list[Rows]], None],
        reply_to: ReplyCallback,
    ) -> None:
        self.waiters.ask(lookups, settle, lambda error: reply_to(self.error(error), True))

    def _read_one(self, target: str, source: str, op: int, stamp_ns: int) -> wire.Message | None:
        """Fast path of a single lookup without options: the reply's fields, or None if the lookup
        fails or is of another kind. The general path then finds out why."""
        tree = self.tree
        newest_ns = None
        try:
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

    def _read(self, lookup: wire.Lookup) -> wire.Message:
        """The reply's fields."""
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
        )
        return wire.lookup_reply(lookup, *rows)

    # --- writes

    def _write(
        self,
        message: wire.Message,
        reply_to: ReplyCallback,
        run: Callable[[wire.Message], wire.Message],
    ) -> None:
        """Run a write at most once, before its expiry, and only on the instance it is meant for."""
        write = wire.parse_write(message)
        now_ns = time.monotonic_ns()
        if write.instance is not None and write.instance != self.instance:
            raise ServerRestarted(
                f"the write is for server instance {write.instance}, but this is instance "
                f"{self.instance}: it did not run; send it again to this one",
                value=write.instance,
            )
        if write.id is not None and self._reply_cache.reply_to_repeat(write.id, reply_to):
            return
        longest_ns = self.limits.expiry_s * 1_000_000_000
        until_ns = now_ns + longest_ns
        if write.expires_ns is not None:
            if write.expires_ns < now_ns:
                late_ms = (now_ns - write.expires_ns) / 1e6
                raise TimeoutException(
                    f"the write arrived {late_ms:.1f} ms after its expiry and did not run: send it "
                    "again, with a longer timeout_s",
                    field="expires_ns",
                    value=write.expires_ns,
                )
            if write.expires_ns > until_ns:
                ahead_s = (write.expires_ns - now_ns) // 1_000_000_000
                raise self.limits.exceeded("expiry_s", ahead_s)
            until_ns = write.expires_ns
        if write.id is None:
            reply_to(self._pack(run(message)), False)
            return
        if not self._reply_cache.begin(write.id, until_ns, now_ns, reply_to):
            return
        failed = False
        try:
            reply = self._pack(run(message))
        except Exception as error:
            reply, failed = self.error(error), True
        self._reply_cache.finish(write.id, reply, failed)
        reply_to(reply, failed)

    def _run_commit(self, message: wire.Message) -> wire.Message:
        commit = wire.parse_commit(message)
        self.limits.check("rows", commit.rows)
        self._future.check(commit)
        stored, ticket = self._commit(commit)
        self._links.wait(ticket)
        return wire.commit_reply(stored)

    def commit(self, commit: wire.Commit, max_stamp_ns: int | None = None) -> Any:
        """Commit a put to the tree: (n,) uint8, 1 stored, 0 dropped, 2 dropped as later than
        `max_stamp_ns`. Static links are stored soon after."""
        return self._commit(commit, max_stamp_ns)[0]

    def _commit(self, commit: wire.Commit, max_stamp_ns: int | None = None) -> tuple[Any, int]:
        """Commit a transaction to the tree: what is stored, and the ticket of its durability."""
        if commit.static:
            return self._links.commit(commit)
        stored = apply(self.tree, commit, max_stamp_ns)
        return stored, self._links.made_dynamic(commit) if self._links.is_stored else NO_TICKET

    # --- batches, info and administration

    def _batch(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        operations = wire.parse_batch(message)
        self.limits.check("rows", len(operations))
        if any(kind == "commit" for kind, _ in operations):
            self._write(message, reply_to, lambda _: self._run_batch(operations, None))
            return
        waiting: dict[int, wire.Lookup] = {}
        reply = self._run_batch(operations, waiting)

        def settle(found: list[Rows]) -> None:
            for (index, lookup), rows in zip(waiting.items(), found, strict=True):
                reply["replies"][index] = wire.lookup_reply(lookup, *rows)
            reply_to(self._pack(reply), False)

        if waiting:
            self._wait(list(waiting.values()), settle, reply_to)
        else:
            reply_to(self._pack(reply), False)

    def _run_batch(
        self, operations: list[tuple[str, wire.Message]], waiting: dict[int, wire.Lookup] | None
    ) -> wire.Message:
        """Run the operations one after another. Lookups that wait are put into `waiting`, by index.
        With `waiting` None they are refused: a batch that writes has a single reply to remember,
        which cannot depend on later writes."""
        rows = 0
        replies: list[wire.Message] = []
        tickets: dict[int, int] = {}
        for kind, body in operations:
            try:
                if kind == "lookup":
                    lookup = wire.parse_lookup(body)
                    rows += lookup.rows
                    self.limits.check("rows", rows)
                    if not lookup.timeout_ns:
                        replies.append(self._read(lookup))
                    elif waiting is not None:
                        waiting[len(replies)] = lookup
                        replies.append({})
                    else:
                        raise InvalidArgumentException(
                            "a lookup in a batch that writes cannot wait: leave out timeout_s, or "
                            "send it in a batch of its own",
                            field="timeout_ns",
                        )
                elif kind == "commit":
                    commit = wire.parse_commit(body)
                    rows += commit.rows
                    self.limits.check("rows", rows)
                    self._future.check(commit)
                    stored, ticket = self._commit(commit)
                    if ticket != NO_TICKET:
                        tickets[len(replies)] = ticket
                    replies.append(wire.commit_reply(stored))
                else:
                    replies.append(self._run_info(body))
            except Exception as error:
                replies.append({"error": wire.encode_error(self._typed(error))})
        try:
            self._links.wait(max(tickets.values(), default=NO_TICKET))  # once for all commits
        except NotDurable as error:
            for index in tickets:
                replies[index] = {"error": wire.encode_error(error)}
        return {"replies": replies}

    def _reply_to_info(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        if message.get("what") == "hello":  # of a client from before this family
            self._reply_to_hello(message, reply_to)
        else:
            reply_to(self._pack(self._run_info(message)), False)

    def _reply_to_hello(self, message: wire.Message, reply_to: ReplyCallback) -> None:
        if "clock_ns" in message:
            told = wire.integer(message, "clock_ns"), wire.integer(message, "round_trip_ns", -1)
            self.clocks.client_told(reply_to.client, *told)
        reply_to(self._pack({"value": self._hello(message)}), False)

    def _run_info(self, message: wire.Message) -> wire.Message:
        if wire.text(message, "what") == "hello":
            return {"value": self._hello(message)}
        return {"value": self._info.value(message)}

    def _counters(self) -> dict[str, int]:
        counters = {"outcomes": len(self._reply_cache), **self.puts.as_dict()}
        counters |= self._links.counters()
        for more in self._more_counters:
            counters |= more()
        return counters

    def _hello(self, message: wire.Message) -> dict[str, Any]:
        access = self.guard.access(message)
        return ({} if access is None else {"access": access}) | {
            "tree": self.name,
            "instance": self.instance,
            "server_version": version("zenoh-tf"),
            "clock_ns": time.monotonic_ns(),
            "limits": self.limits.as_dict(),
        }

    def _run_admin(self, message: wire.Message) -> wire.Message:
        what = wire.text(message, "what")
        if what == "clear":
            ticket = self._links.clear(wire.flag(message, "keep_static", True))
            self._admin_log.info("clear", "cleared the tree")
        elif what == "reset":
            ticket = self._links.reset()
            self._admin_log.info("reset", "reset the tree: every frame is gone")
        elif what == "remove_frame":
            name = wire.text(message, "name")
            ticket = self._links.remove_frame(name, wire.flag(message, "subtree"))
            self._admin_log.info("remove_frame", f"removed frame {quoted(name)}")
        else:
            raise InvalidArgumentException(f"unknown admin operation {quoted(what)}", field="what")
        self._links.wait(ticket)
        return {"value": None}
