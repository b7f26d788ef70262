"""Damaged messages through real Zenoh, at every key of a running server."""

from __future__ import annotations

import random
import re
import threading
import time
from collections import Counter
from dataclasses import dataclass, field

import zenoh

from tests.attack.processes import Server
from tests.support import messages
from zenoh_tf import wire
from zenoh_tf._net import keys

from .seeds import Mutator

_IN_FLIGHT = 64
_QUERY_TIMEOUT_S = 60.0
#: Keys that no client uses: other names, other spellings, and keys below and above real ones.
_ODD_KEYS = (
    "{op}/more",
    "set",
    "set/%",
    "set/%41",
    "set/%1B%5B2J",
    "static/a b",
    "set/a/b",
    "{op}%",
)
#: Control characters other than line feed, and the line separators of Unicode.
_RAW = re.compile(rb"[\x00-\x09\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\xa8\xa9]")


@dataclass
class Report:
    """What came of the messages."""

    outcomes: Counter[str] = field(default_factory=Counter)
    rss_mb: list[float] = field(default_factory=list)  # after each tenth
    log_bytes: int = 0
    raw_in_log: int = 0
    longest_line: int = 0
    slowest_s: float = 0.0


class Sender:
    """Sends damaged messages to one server, many queries at a time."""

    def __init__(self, session: zenoh.Session, seed: int) -> None:
        self._session = session
        self._mutator = Mutator(seed)
        self._random = random.Random(seed)
        self._free = threading.Semaphore(_IN_FLIGHT)
        self._lock = threading.Lock()
        self.report = Report()

    def send(self, count: int) -> None:
        """Send so many messages, and wait until every query has ended."""
        for _ in range(count):
            request_type, payload = self._mutator.next()
            if request_type in keys.REQUEST_TYPES:
                self._query(request_type, payload)
            else:
                self._put(request_type, payload)
        for _ in range(_IN_FLIGHT):
            assert self._free.acquire(timeout=2 * _QUERY_TIMEOUT_S), "a query does not end"
        for _ in range(_IN_FLIGHT):
            self._free.release()

    def _key(self, request_type: str) -> str:
        if self._random.random() < 0.03:
            odd = self._random.choice(_ODD_KEYS).format(op=request_type)
            return f"{keys.PREFIX}/{messages.TREE}/{odd}"
        if request_type in keys.REQUEST_TYPES:
            return keys.request(messages.TREE, request_type)
        names = ("sensor", "", "\x1b[2J\n", "é" * 100, f"name {self._random.randrange(3000)}")
        authority = self._random.choice(names)
        return keys.put(messages.TREE, authority, static=request_type == "static")

    def _put(self, request_type: str, payload: bytes) -> None:
        self._session.put(
            self._key(request_type), payload, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self.report.outcomes["put"] += 1

    def _query(self, request_type: str, payload: bytes) -> None:
        assert self._free.acquire(timeout=2 * _QUERY_TIMEOUT_S), "a query does not end"
        start_s, answered = time.monotonic(), threading.Event()
        key = self._key(request_type)

        def on_reply(reply: zenoh.Reply) -> None:
            answered.set()
            data = reply.ok or reply.err
            assert data is not None
            kind = _kind(data.payload.to_bytes(), reply.ok is None)
            # A damaged time-out may be long; such a lookup waits as long as it says.
            waits = kind == "time-out" and b"timeout_ns" in payload
            self._count("waited" if waits else kind)

        def on_end() -> None:
            if not answered.is_set():
                known = key == keys.request(messages.TREE, request_type)
                self._count("no reply" if known else "no reply at an odd key")
            with self._lock:
                self.report.slowest_s = max(self.report.slowest_s, time.monotonic() - start_s)
            self._free.release()

        self._session.get(
            key,
            zenoh.handlers.Callback(on_reply, on_end, indirect=False),
            payload=payload,
            attachment=self._random.choice((b"", b"a", b"\xff" * 16, b"x" * 200)),
            timeout=_QUERY_TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def _count(self, kind: str) -> None:
        with self._lock:
            self.report.outcomes[kind] += 1


def _kind(data: bytes, failed: bool) -> str:
    if data == b"Timeout":
        return "time-out"
    try:
        message = wire.unpack(data)
        return type(wire.decode_error(message["error"])).__name__ if failed else "ok"
    except Exception as error:
        return f"a reply that cannot be read: {type(error).__name__}"


def play(server: Server, count: int, seed: int) -> Report:
    """Send `count` damaged messages to a server and return what came of them."""
    with messages.session(server.endpoint) as session:
        sender = Sender(session, seed)
        for _ in range(10):
            sender.send(count // 10)
            assert server.running, server.log[-3000:]
            hello = messages.pack({"v": 1, "what": "hello"})
            reply, failed = messages.send(session, "hello", hello)
            assert not failed, reply
            # A tree without content, so that memory is compared at equal states.
            for what in ("clear", "reset"):
                body = {"v": 1, "what": what, "keep_static": False}
                messages.send(session, "admin", messages.pack({k: body[k] for k in list(body)[:2]}))
            sender.report.rss_mb.append(server.rss_mb())
    report, log = sender.report, server.log
    report.log_bytes = len(log)
    report.raw_in_log = len(_RAW.findall(log))
    report.longest_line = max(map(len, log.splitlines()), default=0)
    return report
