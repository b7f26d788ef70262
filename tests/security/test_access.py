"""Every access rule over real TLS: what it allows, what it denies, and that nobody gets around it.

The SDK refuses first, so that its user learns why. The raw sessions do what the SDK would not.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import zenoh

from tests.processes.servers import ServerProcess
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import AccessDenied
from zenoh_tf_client import Credentials, TransformClient
from zenoh_tf_client.requests import columns as client_columns

from .conftest import Files, Serve, connect

LINK = StampedTransform("map", "base", 1, Transform())
STATIC = StampedTransform("base", "camera", 0, Transform())

RULES = """
[[access]]
{kind} = ["reader"]
may = ["read"]

[[access]]
{kind} = ["wheels"]
publish = ["wheels", "odom-*"]

[[access]]
{kind} = ["arm"]
publish = ["arm"]
may = ["read"]

[[access]]
{kind} = ["listener"]
may = ["listen"]

[[access]]
{kind} = ["cleaner"]
may = ["clear"]

[[access]]
{kind} = ["resetter"]
may = ["reset"]

[[access]]
{kind} = ["remover"]
may = ["remove_frame"]

[[access]]
{kind} = ["admin"]
may = ["read", "listen", "clear", "reset", "remove_frame"]
publish = ["*"]
"""


def _batch_of_reads(tf: TransformClient) -> None:
    with tf.batch() as batch:
        batch.lookup_transform("map", "base")
        batch.frames()


Operation = Callable[[TransformClient], object]
OPERATIONS: dict[str, Operation] = {
    "lookup": lambda tf: tf.lookup_transform("map", "base"),
    "batch of reads": _batch_of_reads,
    "lookup that waits": lambda tf: tf.lookup_transform("map", "camera", timeout_s=5.0),
    "frames": lambda tf: tf.frames(),
    "authorities": lambda tf: tf.authorities(),
    "stats": lambda tf: tf.stats(),
    "set as wheels": lambda tf: tf.set_transform(LINK, "wheels"),
    "set static as wheels": lambda tf: tf.set_transform(STATIC, "wheels", static=True),
    "set as odom-left": lambda tf: tf.set_transform(LINK, "odom-left"),
    "set as arm": lambda tf: tf.set_transform(LINK, "arm"),
    "set without authority": lambda tf: tf.set_transform(LINK),
    "batch as wheels": lambda tf: _batch_of_writes(tf, "wheels"),
    "batch as arm": lambda tf: _batch_of_writes(tf, "arm"),
    "broadcast as wheels": lambda tf: tf.broadcaster("wheels").close(),
    "broadcast as arm": lambda tf: tf.broadcaster("arm").close(),
    "clear": lambda tf: tf.clear(),
    "reset": lambda tf: tf.reset(),
    "remove_frame": lambda tf: tf.remove_frame("base", subtree=True),
}
READS = {"lookup", "lookup that waits", "batch of reads", "frames", "authorities", "stats"}
AS_WHEELS = {"set as wheels", "set static as wheels", "batch as wheels", "broadcast as wheels"}
AS_ARM = {"set as arm", "batch as arm", "broadcast as arm"}
ALLOWED = {
    "reader": READS,
    "listener": set(),
    "wheels": AS_WHEELS | {"set as odom-left"},
    "arm": READS | AS_ARM,
    "cleaner": {"clear"},
    "resetter": {"reset"},
    "remover": {"remove_frame"},
    "admin": set(OPERATIONS),
}


def _batch_of_writes(tf: TransformClient, authority: str) -> None:
    with tf.batch() as batch:
        batch.set_transform(LINK, authority)
        batch.set_transform(STATIC, authority, static=True)


@pytest.fixture(scope="module", params=["users", "certificates"])
def secured(
    request: pytest.FixtureRequest,
    files: Files,
    serve: Serve,
    tmp_path_factory: pytest.TempPathFactory,
) -> Secured:
    """A server with the rules, by users and by certificates in turn."""
    config = tmp_path_factory.mktemp("config") / "server.toml"
    config.write_text(RULES.format(kind=request.param))
    by_user = request.param == "users"
    flags = ["--users", files.users] if by_user else ["--tls-ca", files.ca]
    server = serve("--config", str(config), *files.server_flags(), *flags)
    return Secured(server, files.user if by_user else files.owner)


class Secured:
    def __init__(self, server: ServerProcess, credentials: Callable[[str], Credentials]) -> None:
        self.server = server
        self.credentials = credentials

    def client(self, name: str) -> TransformClient:
        return connect(self.server, self.credentials(name))

    @contextmanager
    def raw(self, name: str) -> Iterator[zenoh.Session]:
        """A session that sends whatever it likes."""
        config = zenoh_config.client(
            [self.server.endpoint], 10.0, credentials=self.credentials(name)
        )
        with zenoh.open(config) as session:
            yield session


@pytest.fixture(autouse=True)
def two_links(secured: Secured) -> None:
    with secured.client("admin") as tf:
        tf.reset()
        tf.set_transform(LINK, "admin")
        tf.set_transform(STATIC, "admin", static=True)


@pytest.mark.parametrize("name", ALLOWED)
def test_each_client_may_do_what_its_rules_allow_and_nothing_else(
    secured: Secured, name: str
) -> None:
    with secured.client("admin") as admin, secured.client(name) as tf:
        for operation, run in OPERATIONS.items():
            before = admin.stats()
            if operation in ALLOWED[name]:
                run(tf)
                for link, static in ((LINK, False), (STATIC, True)):
                    admin.set_transform(link, "admin", static)
                continue
            with pytest.raises(AccessDenied) as caught:
                run(tf)
            assert repr(name) in str(caught.value), operation
            assert admin.stats()["commits"] == before["commits"], operation
            assert set(admin.frames()) == {"map", "base", "camera"}, operation


def test_a_client_without_rules_is_told_so(secured: Secured) -> None:
    with pytest.raises(AccessDenied, match=r"'nobody' may do nothing .* no access rule"):
        secured.client("nobody")


def test_one_batch_is_of_one_authority_and_reads_or_writes(secured: Secured) -> None:
    with secured.client("admin") as tf:
        with pytest.raises(AccessDenied, match="'a' and 'b'"), tf.batch() as batch:
            batch.set_transform(LINK, "a")
            batch.set_transform(LINK, "b")
        with pytest.raises(AccessDenied, match="reads and writes"), tf.batch() as batch:
            batch.set_transform(LINK, "a")
            batch.frames()


def test_transactions_work(secured: Secured) -> None:
    with secured.client("arm") as tf:

        def move(tx) -> None:
            found = tx.lookup_transform("map", "base")
            tx.set_transform(
                StampedTransform("map", "base", found.stamp_ns + 1, found.transform), "arm"
            )

        tf.run_transaction(move)
        assert tf.lookup_transform("map", "base").stamp_ns == 2


# --- what the SDK would not send


def commit_body(authority: str | None) -> wire.Message:
    commit = client_columns.commit([LINK], authority or "")
    return wire.commit_body(commit)


DENIED_QUERIES: list[tuple[str, str, wire.Message]] = [
    ("reader", "commit", commit_body("reader")),
    ("reader", "commit/reader", commit_body("reader")),
    ("reader", "batch/reader", wire.batch_body([("commit", commit_body("reader"))])),
    ("reader", "admin", wire.call_body("clear")),
    ("reader", "admin/clear", wire.call_body("clear")),
    ("cleaner", "admin/reset", wire.call_body("reset")),
    ("cleaner", "admin/*", wire.call_body("reset")),
    ("cleaner", "admin/remove_frame", wire.call_body("remove_frame", name="base")),
    ("resetter", "admin/clear", wire.call_body("clear")),
    ("remover", "admin/reset", wire.call_body("reset")),
    ("listener", "info", wire.call_body("frames")),
    ("listener", "commit/listener", commit_body("listener")),
    ("cleaner", "info", wire.call_body("frames")),
    ("wheels", "info", wire.call_body("frames")),
    ("wheels", "lookup", wire.one_read("map", "base", wire.OP_COMMON, wire.NO_STAMP)),
    ("wheels", "commit", commit_body("wheels")),
    ("wheels", "commit/arm", commit_body("arm")),
    ("wheels", "commit/*", commit_body("wheels")),
    ("wheels", "**", commit_body("wheels")),
]


@pytest.mark.parametrize(("name", "key", "body"), DENIED_QUERIES)
def test_denied_queries_reach_nothing(
    secured: Secured, name: str, key: str, body: wire.Message
) -> None:
    with secured.client("admin") as admin, secured.raw(name) as session:
        before = admin.stats()["commits"]
        replies = list(session.get(f"{keys.prefix('main')}/{key}", payload=wire.pack(body)))
        assert [reply.ok for reply in replies if reply.ok] == []
        assert admin.stats()["commits"] == before
        assert len(admin.frames()) == 3


def refusal(session: zenoh.Session, key: str, body: wire.Message) -> Exception:
    (reply,) = session.get(f"{keys.prefix('main')}/{key}", payload=wire.pack(body))
    assert reply.err is not None
    return wire.decode_error(wire.unpack(reply.err.payload.to_bytes())["error"])


def test_the_message_must_agree_with_its_key(secured: Secured) -> None:
    with secured.raw("wheels") as session:
        as_arm = commit_body("arm")
        for key, body in (
            ("commit/wheels", as_arm),
            ("batch/wheels", wire.batch_body([("commit", as_arm)])),
            ("batch/wheels", wire.batch_body([("info", wire.call_body("frames"))])),
        ):
            assert isinstance(refusal(session, key, body), AccessDenied), key
    with secured.raw("cleaner") as session:
        error = refusal(session, "admin/clear", wire.call_body("reset"))
        assert isinstance(error, AccessDenied)
    with secured.raw("reader") as session:
        batch = wire.batch_body([("commit", commit_body("reader"))])
        assert isinstance(refusal(session, "batch", batch), AccessDenied)
    with secured.client("admin") as admin:
        assert {record.name for record in admin.authorities()} <= {"admin", "wheels", "arm", ""} | {
            "odom-left"
        }


def test_a_commit_without_authority_gets_the_key_s(secured: Secured) -> None:
    with secured.raw("wheels") as session, secured.client("admin") as admin:
        admin.reset()
        (reply,) = session.get(
            f"{keys.prefix('main')}/commit/wheels", payload=wire.pack(commit_body(None))
        )
        assert reply.ok is not None
        assert admin.frame("base").authority == "wheels"


def test_puts_are_let_through_for_their_authorities_only(secured: Secured) -> None:
    payload = wire.pack(commit_body(None))
    with secured.client("admin") as admin, secured.raw("wheels") as session:
        before = admin.stats()
        for authority in ("arm", "admin", "", "odom"):
            for static in (True, False):
                session.put(keys.put("main", authority, static=static), payload)
        session.put(f"{keys.prefix('main')}/set/*", payload)
        allowed = [("odom-left", False), ("odom-left", True), ("wheels", True), ("wheels", False)]
        for authority, static in allowed:
            session.put(keys.put("main", authority, static=static), payload)
        # A session's messages arrive in order: the last one is there, so all are.
        while admin.stats()["puts"] < before["puts"] + len(allowed):
            time.sleep(0.01)
        assert admin.stats()["puts"] == before["puts"] + len(allowed)
        assert admin.stats()["bad_puts"] == before["bad_puts"]


def test_only_listeners_hear_puts(secured: Secured) -> None:
    heard: dict[str, list[str]] = {"listener": [], "reader": [], "wheels": []}
    payload = wire.pack(commit_body(None))

    def listener_of(name: str) -> Callable[[zenoh.Sample], None]:
        return lambda sample: heard[name].append(str(sample.key_expr))

    with (
        secured.raw("listener") as listener,
        secured.raw("reader") as reader,
        secured.raw("wheels") as wheels,
    ):
        for name, session in (("listener", listener), ("reader", reader), ("wheels", wheels)):
            both = ["tf/v1/main/set/*", "tf/v1/main/static/*"]
            for key in (*both, f"{keys.prefix('main')}/**", "**"):
                session.declare_subscriber(key, listener_of(name))
        sent = {keys.put("main", "wheels", static=static) for static in (False, True)}
        while set(heard["listener"]) != sent:  # a put is lost while a subscription is on its way
            for key in sent:
                wheels.put(key, payload)
            time.sleep(0.05)
        assert heard["reader"] == []


@pytest.mark.parametrize("name", ["nobody", "reader", "admin"])
def test_nobody_poses_as_the_server(secured: Secured, name: str) -> None:
    with secured.client("reader") as tf, secured.raw(name) as session:
        instance = tf.instance
        answered: list[str] = []

        def answer(query: zenoh.Query) -> None:
            answered.append(str(query.key_expr))
            query.drop()

        for key in (keys.request("main", "lookup"), f"{keys.prefix('main')}/**", "**"):
            session.declare_queryable(key, answer)
        session.liveliness().declare_token(keys.server("main", "0000"))
        # The token of a client is allowed, and arrives after the others.
        session.liveliness().declare_token(keys.client("main", "marker"))
        for _ in range(20):
            tf.lookup_transform("map", "base")
            list(session.get(keys.request("main", "hello")))
        with secured.raw("reader") as other:
            tokens = [
                str(reply.ok.key_expr)
                for reply in other.liveliness().get(keys.servers("main"))
                if reply.ok
            ]
        assert tokens == [keys.server("main", instance)]
        assert tf.instance == instance
        assert {each for each in answered if "hello" not in each} == set()


def test_the_router_carries_nothing_else(secured: Secured) -> None:
    heard: list[str] = []
    with secured.raw("admin") as one, secured.raw("reader") as other:
        one.declare_subscriber("else/**", lambda sample: heard.append(str(sample.key_expr)))
        for _ in range(20):
            other.put("else/where", b"")
            list(other.get(keys.request("main", "hello")))
        assert heard == []


def test_passwords_are_not_in_the_log(secured: Secured) -> None:
    log = secured.server.log
    assert "secret-of" not in log and "Traceback" not in log


# --- the stream


def test_the_stream_is_for_clients_that_may_read(secured: Secured) -> None:
    heard: dict[str, queue.Queue[str]] = {"reader": queue.Queue(), "listener": queue.Queue()}
    with (
        secured.raw("reader") as reader,
        secured.raw("listener") as listener,
        secured.raw("wheels") as forger,
        secured.client("admin") as tf,
    ):
        for name, session in (("listener", listener), ("reader", reader)):

            def received(sample: zenoh.Sample, name: str = name) -> None:
                heard[name].put(str(sample.key_expr))

            session.declare_subscriber(keys.streams("main"), received)
        key = heard["reader"].get(timeout=10.0)
        assert key.startswith("tf/v1/main/stream/")
        # Nobody but the server may say what has changed.
        forger.put(keys.stream("main", "forged"), b"")
        tf.set_transform(LINK, "admin")
        for _ in range(5):
            assert heard["reader"].get(timeout=10.0) == key
        assert heard["listener"].empty()
        for operation in ("snapshot", "missed"):
            assert list(reader.get(keys.request("main", operation), timeout=5.0))
            assert not list(listener.get(keys.request("main", operation), timeout=5.0))
    with secured.client("reader") as client, client.mirror([("map", "base")]) as m:
        assert m.lookup_latest_transform("map", "base").stamp_ns == LINK.stamp_ns
    with secured.client("listener") as client, pytest.raises(AccessDenied):
        client.mirror([("map", "base")])
