"""Replicas whose clients must show who they are: what they may do, hear and learn there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest
import zenoh

from tests.conftest import ServerProcess, free_endpoint
from tests.processes.replicas import seen, step, wait_for_writes
from tests.support.waiting import wait_until
from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import AccessDenied, ReadOnlyReplica
from zenoh_tf_client import Credentials, TransformClient

from .conftest import PASSWORDS, Files, Serve, tls_endpoint

PRIMARY_RULES = """
[[access]]
{kind} = ["{replica}"]
may = ["read"]

[[access]]
{kind} = ["admin"]
may = ["read", "listen", "clear", "reset", "remove_frame"]
publish = ["*"]
"""
REPLICA_RULES = """
[[access]]
{kind} = ["admin"]
may = ["read", "listen", "clear", "reset", "remove_frame"]
publish = ["*"]

[[access]]
{kind} = ["wheels"]
may = ["read"]
"""


@dataclass(frozen=True)
class Site:
    primary: ServerProcess
    replica: ServerProcess
    credentials: Callable[[str], Credentials]

    def client(self, name: str, server: ServerProcess | None = None) -> TransformClient:
        where = (server or self.replica).endpoint
        own = self.credentials(name)
        return TransformClient.connect(where, timeout_s=10, credentials=own, reads="query")

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
    """A primary and a replica with rules of their own. The replica connects as `arm`."""
    folder = tmp_path_factory.mktemp("site")
    by_user = request.param == "users"
    name = "arm" if by_user else "arm-server"
    rules: list[tuple[str, str]] = []
    for text in (PRIMARY_RULES, REPLICA_RULES):
        path = folder / f"rules{len(rules)}.toml"
        path.write_text(text.format(kind=request.param, replica=name))
        rules.append(("--config", str(path)))
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
    primary = serve(*rules[0], "--no-share", *flags, endpoint=where())
    replica = serve(
        *("--replica-of", primary.endpoint, "--no-share", *rules[1], *own), endpoint=where()
    )
    return Site(primary, replica, _by_password if by_user else files.owner)


def _by_password(name: str) -> Credentials:
    return Credentials(user=name, password=PASSWORDS[name])


def test_a_replica_has_rules_of_its_own(site: Site) -> None:
    with site.client("admin", site.primary) as writer, site.client("wheels") as tf:
        writer.set_transforms_xact(step(1))
        wait_for_writes(writer, tf)
        assert seen(tf) == 1
        with pytest.raises(AccessDenied):  # at the primary, it has no rights
            site.client("wheels", site.primary)
        with pytest.raises(AccessDenied):
            site.client("nobody")
        for denied in (tf.reset, tf.clear, lambda: tf.set_transforms_xact(step(2), "wheels")):
            with pytest.raises(AccessDenied):
                denied()
    with site.client("admin") as tf:
        for write in (
            tf.reset,
            lambda: tf.set_transforms_xact(step(2), "arm"),
            lambda: tf.broadcaster("arm"),
        ):
            with pytest.raises(ReadOnlyReplica):
                write()


def test_a_client_cannot_falsify_what_others_read(site: Site) -> None:
    with (
        site.client("admin", site.primary) as writer,
        site.client("admin") as tf,
        site.raw("wheels") as attacker,
        tf.mirror() as m,
    ):
        writer.set_transforms_xact(step(5))
        wait_for_writes(writer, tf)
        answered: list[str] = []

        def answer(query: zenoh.Query) -> None:
            answered.append(str(query.key_expr))
            query.drop()

        for key in (f"{keys.prefix('main')}/**", "**", keys.request("main", "lookup")):
            attacker.declare_queryable(key, answer, complete=True)
        attacker.liveliness().declare_token(keys.server("main", "0000"))
        forged = wire.pack(wire.stream_body(wire.StreamMessage(tf.instance, 1, 1 << 62, 1 << 62)))
        for key in (keys.stream("main", tf.instance), "tf/v1/main/stream/*", "tf/v1/main/**", "**"):
            attacker.put(key, forged)
        for stamp in range(6, 30):
            writer.set_transforms_xact(step(stamp))
        wait_for_writes(writer, tf)
        m.wait_for(writer.last_receipt)
        assert seen(tf) == m.lookup_transform("map", "frame0").stamp_ns == 29
        tokens = attacker.liveliness().get(keys.servers("main"))
        assert [str(each.ok.key_expr) for each in tokens if each.ok] == [
            keys.server("main", tf.instance)
        ]
        assert {each for each in answered if "hello" not in each} == set()
        assert tf.stats()["replica_contradictions"] == 0
        wait_until(lambda: m.synced, "the mirror has lost its place")
    assert "contradicts" not in site.replica.log
