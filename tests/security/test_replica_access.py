"""Replicas whose clients must show who they are: what they may do, hear and learn there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest
import zenoh

from tests.conftest import ServerProcess, free_endpoint
from tests.processes.replicas import reads_near, seen, step
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import AccessDenied
from zenoh_tf_client import Credentials, TransformClient

from .conftest import PASSWORDS, Files, Serve, tls_endpoint

RULES = """
[[access]]
{kind} = ["{replica}"]
may = ["read"]
publish = ["arm", ""]

[[access]]
{kind} = ["admin"]
may = ["read", "listen", "clear", "reset", "remove_frame"]
publish = ["*"]

[[access]]
{kind} = ["wheels"]
publish = ["wheels"]
"""
LINK = StampedTransform("map", "base", 1, Transform())


@dataclass(frozen=True)
class Site:
    primary: ServerProcess
    replica: ServerProcess
    credentials: Callable[[str], Credentials]

    def client(self, name: str) -> TransformClient:
        return TransformClient.connect(
            self.replica.endpoint, timeout_s=10, credentials=self.credentials(name), reads="query"
        )

    @contextmanager
    def raw(self, name: str) -> Iterator[zenoh.Session]:
        own = self.credentials(name)
        with zenoh.open(zenoh_config.client([self.replica.endpoint], 10, credentials=own)) as it:
            yield it


@pytest.fixture(scope="module", params=["users", "certificates"])
def site(
    request: pytest.FixtureRequest,
    files: Files,
    serve: Serve,
    tmp_path_factory: pytest.TempPathFactory,
) -> Site:
    """A primary with rules, and a replica that connects as `arm`."""
    folder = tmp_path_factory.mktemp("site")
    by_user = request.param == "users"
    name = "arm" if by_user else "arm-server"
    (folder / "rules.toml").write_text(RULES.format(kind=request.param, replica=name))
    if by_user:
        (folder / "password").write_text(PASSWORDS["arm"])
        (folder / "password").chmod(0o600)
        own = ["--user", "arm", "--password-file", str(folder / "password")]
        flags = ["--users", files.users]
        own += flags
    else:
        flags = ["--tls-ca", files.ca, *files.server_flags()]
        own = ["--tls-ca", files.ca, *files.server_flags("arm-server")]
    where = free_endpoint if by_user else tls_endpoint
    rules = ("--config", str(folder / "rules.toml"))
    primary = serve(*rules, "--no-share", *flags, endpoint=where())
    replica = serve("--replica-of", primary.endpoint, "--no-share", *own, endpoint=where())
    return Site(primary, replica, _by_password if by_user else files.owner)


def _by_password(name: str) -> Credentials:
    return Credentials(user=name, password=PASSWORDS[name])


def test_every_client_has_the_rights_of_the_replica_s_user(site: Site) -> None:
    """Whatever the primary's rules say of its own name: they do not see who it is."""
    for name in ("admin", "wheels", "nobody"):
        with site.client(name) as tf:
            assert reads_near(tf)
            tf.set_transforms_xact(step(1))
            tf.set_transform(LINK, "arm")
            assert seen(tf) == 1
            for denied in (
                tf.reset,
                tf.clear,
                lambda tf=tf: tf.set_transform(LINK, "wheels"),
                lambda tf=tf: tf.broadcaster("wheels"),
            ):
                with pytest.raises(AccessDenied, match="replica"):
                    denied()


def test_rights_that_changed_meanwhile_are_no_unknown_outcome(site: Site) -> None:
    with site.client("admin") as tf:
        tf._connection.exchange.access = None  # as if it had never received it
        with pytest.raises(AccessDenied):
            tf.reset()


def test_a_client_cannot_falsify_what_others_read(site: Site) -> None:
    with site.client("admin") as tf, site.raw("nobody") as attacker, tf.mirror() as m:
        tf.set_transforms_xact(step(5))
        wait_until(lambda: m.synced and seen(tf) == 5, "the copy is not complete")
        heard: list[str] = []
        answered: list[str] = []

        def answer(query: zenoh.Query) -> None:
            answered.append(str(query.key_expr))
            query.drop()

        for key in (f"{keys.prefix('main')}/**", "**", keys.request("main", "lookup")):
            attacker.declare_queryable(key, answer)
            attacker.declare_subscriber(key, lambda sample: heard.append(str(sample.key_expr)))
        router = str(attacker.info.routers_zid()[0])
        near = keys.replica_request("main", router, "lookup")
        attacker.declare_queryable(near, answer, complete=True)
        attacker.liveliness().declare_token(keys.server("main", "0000"))
        forged = wire.pack(wire.stream_body(wire.StreamMessage(tf.instance, 1, 1 << 62, 1 << 62)))
        for key in (keys.stream("main", tf.instance), "tf/v1/main/stream/*", "tf/v1/main/**", "**"):
            attacker.put(key, forged)
        for stamp in range(6, 30):
            tf.set_transforms_xact(step(stamp))
            assert seen(tf) == stamp
        m.wait_for()
        assert seen(tf) == m.lookup_transform("map", "frame0").stamp_ns == 29
        with tf.broadcaster("arm") as arm:
            arm.send(StampedTransform("map", "hand", 1, Transform()))
            wait_until(lambda: tf.can_transform("map", "hand"), "the put has not arrived")
        tokens = attacker.liveliness().get(keys.servers("main"))
        assert [str(each.ok.key_expr) for each in tokens if each.ok] == [
            keys.server("main", tf.instance)
        ]
        assert {each for each in answered if "hello" not in each} == set()
        assert not [each for each in heard if "/set/" in each or "/static/" in each]
        assert tf.stats()["replica_contradictions"] == 0
    assert "contradicts" not in site.replica.log
