"""What the service answers, without Zenoh: message bytes in, reply bytes out.

Thread safety: `handle` from any number of threads; each answer is called exactly once,
for a waiting lookup later and from another thread.
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
    ServerRestarted,
    TimeoutException,
    TransformException,
)

from . import introspection
from .ingest import PutCounters
from .limits import Limits
from .outcomes import Answer, Outcomes
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
    ) -> None:
        self.tree = tree
        self.instance = instance
        self.limits = limits
        self.outcomes = Outcomes(limits)
        self.waiters = Waiters(tree, limits, loop)
        #: Counted by the ingest of sensors' puts; part of the statistics.
        self.puts = PutCounters()
        self._name = name
        self._operations: dict[str, Callable[[wire.Message, Answer], None]] = {
            "lookup": self._lookup,
            "commit": lambda message, answer: self._write(message, answer, self._run_commit),
            "batch": self._batch,
            "info": lambda message, answer: answer(self._seal(self._run_info(message)), False),
            "admin": lambda message, answer: self._write(message, answer, self._run_admin),
        }

    def handle(self, operation: str, payload: bytes, answer: Answer) -> None:
        """Answer one request. Never raises: what goes wrong is the answer."""
        try:
            message = wire.unpack(payload, self.limits.message_bytes)
            self._operations[operation](message, answer)
        except Exception as error:
            answer(self.error(error), True)

    def error(self, error: Exception) -> bytes:
        """The reply to a request that failed as a whole."""
        return wire.pack(wire.error_reply(self.instance, self._typed(error)))

    def close(self) -> None:
        self.waiters.close()

    @staticmethod
    def _typed(error: Exception) -> TransformException:
        if not isinstance(error, (TransformException, TypeError, ValueError, OverflowError)):
            log.exception("internal error", exc_info=error)
        return wire.as_transform_exception(error)

    def _seal(self, reply: wire.Message) -> bytes:
        reply["v"] = wire.VERSION
        reply["instance"] = self.instance
        return wire.pack(reply)

    # --- reads

    def _lookup(self, message: wire.Message, answer: Answer) -> None:
        one = wire.parse_one_read(message)
        if one is not None and (found := self._read_one(*one)) is not None:
            answer(self._seal(found), False)
            return
        lookup = wire.parse_lookup(message)
        self.limits.check("rows", lookup.rows)
        if lookup.timeout_ns:

            def settle(found: list[Rows]) -> None:
                answer(self._seal(wire.lookup_reply(lookup, *found[0])), False)

            self._wait([lookup], settle, answer)
        else:
            answer(self._seal(self._read(lookup)), False)

    def _wait(
        self,
        lookups: list[wire.Lookup],
        settle: Callable[[list[Rows]], None],
        answer: Answer,
    ) -> None:
        self.waiters.ask(lookups, settle, lambda error: answer(self.error(error), True))

    def _read_one(self, target: str, source: str, op: int, stamp_ns: int) -> wire.Message | None:
        """The reply's fields to a plain single read; None for any other or a failed one."""
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
        answer: Answer,
        run: Callable[[wire.Message], wire.Message],
    ) -> None:
        """Run a write once: by id, before its expiry, on the instance that it is meant for."""
        write = wire.parse_write(message)
        now_ns = time.monotonic_ns()
        if write.instance is not None and write.instance != self.instance:
            raise ServerRestarted(
                f"meant for server instance {write.instance}, this one is {self.instance}",
                value=write.instance,
            )
        if write.id is not None and self.outcomes.repeat(write.id, answer):
            return
        longest_ns = self.limits.expiry_s * 1_000_000_000
        until_ns = now_ns + longest_ns
        if write.expires_ns is not None:
            if write.expires_ns < now_ns:
                late_ms = (now_ns - write.expires_ns) / 1e6
                raise TimeoutException(
                    f"the write expired {late_ms:.1f} ms before it could run, and did not run",
                    field="expires_ns",
                    value=write.expires_ns,
                )
            if write.expires_ns > until_ns:
                ahead_s = (write.expires_ns - now_ns) // 1_000_000_000
                raise self.limits.exceeded("expiry_s", ahead_s)
            until_ns = write.expires_ns
        if write.id is None:
            answer(self._seal(run(message)), False)
            return
        if not self.outcomes.begin(write.id, until_ns, now_ns, answer):
            return
        failed = False
        try:
            reply = self._seal(run(message))
        except Exception as error:
            reply, failed = self.error(error), True
        self.outcomes.finish(write.id, reply, failed)
        answer(reply, failed)

    def _run_commit(self, message: wire.Message) -> wire.Message:
        commit = wire.parse_commit(message)
        self.limits.check("rows", commit.rows)
        return wire.commit_reply(self.commit(commit))

    def commit(self, commit: wire.Commit) -> Any:
        """Commit a transaction to the tree: (n,) uint8, 1 stored, 0 dropped as too old."""
        return self.tree._commit_rows(
            commit.names,
            commit.parent,
            commit.child,
            commit.stamp,
            commit.pose,
            authority=commit.authority,
            static=commit.static,
            drop_old=commit.drop_old,
            read_names=commit.read_names,
            read_versions=commit.read_versions,
        )

    # --- the others

    def _batch(self, message: wire.Message, answer: Answer) -> None:
        operations = wire.parse_batch(message)
        self.limits.check("rows", len(operations))
        if any(kind == "commit" for kind, _ in operations):
            self._write(message, answer, lambda _: self._run_batch(operations, None))
            return
        waiting: dict[int, wire.Lookup] = {}
        reply = self._run_batch(operations, waiting)

        def settle(found: list[Rows]) -> None:
            for (index, lookup), rows in zip(waiting.items(), found, strict=True):
                reply["replies"][index] = wire.lookup_reply(lookup, *rows)
            answer(self._seal(reply), False)

        if waiting:
            self._wait(list(waiting.values()), settle, answer)
        else:
            answer(self._seal(reply), False)

    def _run_batch(
        self, operations: list[tuple[str, wire.Message]], waiting: dict[int, wire.Lookup] | None
    ) -> wire.Message:
        """Run one after another. Lookups that wait go into `waiting`, by index; None: where
        a batch writes they are refused, since its outcome is one."""
        rows = 0
        replies: list[wire.Message] = []
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
                            "a lookup in a batch that writes cannot wait", field="timeout_ns"
                        )
                elif kind == "commit":
                    commit = wire.parse_commit(body)
                    rows += commit.rows
                    self.limits.check("rows", rows)
                    replies.append(wire.commit_reply(self.commit(commit)))
                else:
                    replies.append(self._run_info(body))
            except Exception as error:
                replies.append({"error": wire.fault(self._typed(error))})
        return {"replies": replies}

    def _run_info(self, message: wire.Message) -> wire.Message:
        if wire.text(message, "what") == "hello":
            return {"value": self._hello()}
        return {"value": introspection.answer(self, message)}

    def _hello(self) -> dict[str, Any]:
        return {
            "tree": self._name,
            "instance": self.instance,
            "server_version": version("zenoh-tf"),
            "clock_ns": time.monotonic_ns(),
            "limits": self.limits.as_dict(),
        }

    def _run_admin(self, message: wire.Message) -> wire.Message:
        what = wire.text(message, "what")
        if what == "clear":
            self.tree.clear(wire.flag(message, "keep_static", True))
            log.info("cleared")
        elif what == "remove_frame":
            name = wire.text(message, "name")
            self.tree.remove_frame(name, wire.flag(message, "subtree"))
            log.info("removed frame %r", name)
        else:
            raise InvalidArgumentException(f"no admin operation {what!r}", field="what")
        return {"value": None}
