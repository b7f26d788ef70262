"""Attacks 15, 20, 21 and 22: clients of replicas, mirrors and chains, and what they leave."""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import zenoh

from tests.processes.ports import free_endpoint
from tests.support import messages
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import AccessDenied, ReadOnlyReplica, TransformException
from zenoh_tf_client import Credentials, TransformClient

from .arena import Arena, Finding, case
from .processes import Server, attacker

_USERS = {name: f"secret of {name}" for name in ("site", "honest", "attacker")}
_RULES = """
[[access]]
users = ["site"]
may = ["read"]
publish = ["*"]

[[access]]
users = ["honest"]
may = ["read", "reset"]
"""
_STEPS = 200


def _flags(folder: Path) -> tuple[str, ...]:
    users = folder / "users"
    users.write_text("".join(f"{name}:{password}\n" for name, password in _USERS.items()))
    password = folder / "password"
    password.write_text(_USERS["site"])
    for path in (users, password):
        path.chmod(0o600)
    return "--users", str(users), "--no-share"


@contextlib.contextmanager
def _protected(arena: Arena, *, chain: int = 1, rules: str = "") -> Iterator[list[Server]]:
    """A primary with passwords, and replicas of it, each of the one before."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        flags = _flags(folder)
        config = folder / "rules.toml"
        config.write_text(rules)
        servers = [stack.enter_context(arena.server("--config", str(config), *flags))]
        password = str(folder / "password")
        own = ("--user", "site", "--password-file", password, "--config", str(config))
        for _ in range(chain):
            where = ("--replica-of", servers[-1].endpoint)
            servers.append(stack.enter_context(arena.server(*where, *own, *flags)))
        yield servers


def _client(server: Server, user: str | None = None) -> TransformClient:
    own = Credentials() if user is None else Credentials(user=user, password=_USERS[user])
    return TransformClient.connect(server.endpoint, timeout_s=20, credentials=own, reads="query")


@contextlib.contextmanager
def _raw(server: Server, user: str | None = None) -> Iterator[zenoh.Session]:
    own = Credentials() if user is None else Credentials(user=user, password=_USERS[user])
    with zenoh.open(zenoh_config.client([server.endpoint], 20, credentials=own)) as opened:
        yield opened


def _pose(stamp: int) -> StampedTransform:
    return StampedTransform("map", "base", stamp, Transform((stamp, 0, 0)))


def _forge(opened: zenoh.Session, tree: TransformClient, answered: list[str]) -> None:
    """All that may pass for the server's messages, replies and tokens."""

    def answer(query: zenoh.Query) -> None:
        if "hello" not in str(query.key_expr):
            answered.append(str(query.key_expr))
        query.drop()

    for key in (f"{keys.prefix('main')}/**", keys.request("main", "lookup")):
        opened.declare_queryable(key, answer, complete=True)
    opened.liveliness().declare_token(keys.server("main", "0000"))
    stream = keys.stream("main", tree.instance)
    for key in (stream, "tf/v1/main/stream/*", "tf/v1/main/**", "**"):
        for first, last in ((1, 1 << 62), (1 << 61, 1 << 61), (1, 3)):
            message = wire.StreamMessage(tree.instance, first, last, 1 << 62)
            opened.put(key, wire.pack(wire.stream_body(message)))


def _forged(server: Server, primary: Server, user: str | None, reader: str | None) -> list[Finding]:
    """What another client reads at a server, while one forges."""
    answered: list[str] = []
    wrong = failed = 0
    with _client(primary, reader) as writer, _client(server, reader) as tf, tf.mirror() as m:
        with _raw(server, user) as opened:
            for stamp in range(1, _STEPS + 1):
                writer.set_transform(_pose(stamp))
                if stamp % 20 == 1:
                    _forge(opened, tf, answered)
                try:
                    wrong += tf.lookup_transform("map", "base").transform.translation[0] > stamp
                    wrong += m.lookup_transform("map", "base").transform.translation[0] > stamp
                except TransformException:
                    failed += stamp > 1  # a fresh replica may not have the first one yet
        writer.set_transform(_pose(_STEPS + 1))
        begin_s = time.monotonic()
        while time.monotonic() < begin_s + 20:
            found = [each.lookup_transform("map", "base").stamp_ns for each in (tf, m)]
            if found == [_STEPS + 1] * 2:
                break
            time.sleep(0.02)
        lag_s = time.monotonic() - begin_s
    return [
        Finding("poses that nobody has set", wrong, "", 0),
        Finding("lookups that failed", failed, "", 0, f"of {2 * _STEPS}"),
        Finding("queries of others at the attacker", len(answered), "", 0),
        Finding("right again after the last write", lag_s, "s", 5.0),
    ]


@case("15: a client of a replica with passwords forges messages, replies and the server's token")
def falsified_replica(arena: Arena) -> list[Finding]:
    with _protected(arena) as (primary, replica):
        found = _forged(replica, primary, "attacker", "honest")
        noticed = b"contradicts" in replica.log
    return [*found, Finding("forged messages that came through", noticed, "", 0)]


@case("15b: the same at the second replica of a chain")
def falsified_chain(arena: Arena) -> list[Finding]:
    with _protected(arena, chain=2) as (primary, _, last):
        return _forged(last, primary, "attacker", "honest")


@case("15c: the stream's number is forged on a server without users: mirrors and replicas recover")
def poisoned_mirrors(arena: Arena) -> list[Finding]:
    with (
        arena.server("--no-share") as primary,
        arena.server("--replica-of", primary.endpoint, "--no-share") as replica,
        _client(primary) as writer,
        _client(replica) as tf,
        writer.mirror() as m,
        _raw(primary) as opened,
    ):
        writer.set_transform(_pose(1))
        m.wait_for()
        stream = keys.stream("main", tf.instance)
        for first, last in ((1, 1 << 62), (2, 500), (1 << 61, 1 << 61)):
            message = wire.StreamMessage(tf.instance, first, last, 1 << 62)
            opened.put(stream, wire.pack(wire.stream_body(message)))
            time.sleep(0.2)
        begin_s, stamp, right = time.monotonic(), 1, False
        while not right and time.monotonic() < begin_s + 30:
            stamp += 1
            writer.set_transform(_pose(stamp))
            time.sleep(0.05)
            near, receipt = tf.stats(), writer.last_receipt
            assert receipt is not None
            seqs = near.get("replica_seq", 0), m.seq
            right = all(receipt.seq - 5 < seq <= receipt.seq for seq in seqs)
        lag_s = time.monotonic() - begin_s
        reported = b"contradicts" in replica.log and near["replica_contradictions"] > 0
    return [
        Finding("frozen for", lag_s, "s", 20.0),
        Finding("the forgery is not reported", not reported, "", 0),
    ]


@case("20: what users may do at a replica is what its own rules say, and never a write")
def rights_at_a_replica(arena: Arena) -> list[Finding]:
    wrong: list[str] = []
    with _protected(arena, rules=_RULES) as (_, replica):
        for user, expected in (("honest", ReadOnlyReplica), ("attacker", AccessDenied)):
            try:
                with _client(replica, user) as tf:
                    tf.reset()
                    wrong.append(f"{user} resets")
            except TransformException as error:
                if type(error) is not expected:
                    wrong.append(f"{user} resets: {type(error).__name__}")
    return [Finding("rights that are reported wrongly", len(wrong), "", 0, "; ".join(wrong))]


@case("21: reads of one client around eight restarts of its replica, beside a writer")
def back_in_time(arena: Arena) -> list[Finding]:
    endpoint = free_endpoint()
    ending = threading.Event()
    with arena.server("--no-share") as primary:

        def write() -> None:
            with _client(primary) as writer:
                stamp = 1
                while not ending.is_set():
                    stamp += 1
                    writer.set_transform(_pose(stamp))

        with _client(primary) as first:
            first.set_transform(_pose(1))
        writing = threading.Thread(target=write)
        writing.start()
        reads = back = latest = 0
        try:
            with contextlib.ExitStack() as stack:
                flags = ("--replica-of", primary.endpoint, "--no-share")
                replica = stack.enter_context(arena.server(*flags, endpoint=endpoint))
                tf = stack.enter_context(_client(replica))
                for _ in range(8):
                    replica.end()
                    replica = stack.enter_context(arena.server(*flags, endpoint=endpoint))
                    until_s = time.monotonic() + 1.5
                    while time.monotonic() < until_s:
                        with contextlib.suppress(TransformException):
                            stamp = tf.lookup_transform("map", "base").stamp_ns
                            reads += 1
                            back += stamp < latest
                            latest = max(latest, stamp)
        finally:
            ending.set()
            writing.join()
    return [
        Finding("reads that went back", back, "", 0, f"of {reads}"),
        Finding("no read at all", reads == 0, "", 0),
    ]


@case("22: lookups that wait for ten minutes, of a client without a token and of a killed one")
def abandoned_waiters(arena: Arena) -> list[Finding]:
    with arena.opened("--no-share") as (server, opened):
        body = messages.same_lookup(1, "root", "never") | {"timeout_ns": 600 * 10**9}
        kind = messages.kind_of(*messages.send(opened, "lookup", messages.pack(body), 30.0))

        def waiters() -> int:
            with _client(server) as tf:
                return tf.stats()["waiters"]

        with attacker(server.endpoint, "known_waiters", "100", "600") as greedy:
            greedy.go()
            greedy.stdout.readline()
            began = _until(lambda: waiters() >= 100, 10.0)
        gone_s = _until(lambda: waiters() == 0, 30.0)
    return [
        Finding("a client without a token waits", kind != "ServerBusy", "", 0, kind),
        Finding("the others wait after", began, "s", 10.0),
        Finding("waiters held after a kill", gone_s, "s", 5.0),
    ]


def _until(condition: Callable[[], bool], timeout_s: float) -> float:
    begin_s = time.monotonic()
    while not condition() and time.monotonic() < begin_s + timeout_s:
        time.sleep(0.05)
    return time.monotonic() - begin_s
