"""Which settings a server refuses to start with, and when it warns."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes import servers
from tests.processes.ports import free_endpoint
from zenoh_tf._net import keys
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf_client import Credentials, TransformClient
from zenoh_tf_server import flags
from zenoh_tf_server.security import settings as security
from zenoh_tf_server.security.access_control import KEYED, READS
from zenoh_tf_server.security.access_rules import AccessRule, authority_chunk, granted
from zenoh_tf_server.security.settings import Security

from .conftest import Files

TLS = "tls/0.0.0.0:1"


def settings(*arguments: str, rules: tuple[AccessRule, ...] = ()) -> Security:
    parser = flags.parser()
    options = parser.parse_args(arguments)
    flags.complete(parser, options)
    return security.from_flags(options, rules)


def refused(*arguments: str, rules: tuple[AccessRule, ...] = ()) -> str:
    with pytest.raises(InvalidArgumentException) as caught:
        settings(*arguments, rules=rules)
    return str(caught.value)


def test_tls_files_belong_together(files: Files, tmp_path: Path) -> None:
    certificate, key = files.certificate("server"), files.key("server")
    listen = ("--listen", TLS)
    assert "--tls-key is missing" in refused(*listen, "--tls-certificate", certificate)
    assert "--tls-certificate is missing" in refused(*listen)
    assert "--tls-ca needs" in refused("--tls-ca", files.ca)
    pair = ("--tls-certificate", certificate, "--tls-key", key)
    assert "--listen has no endpoint" in refused(*pair)
    other = ("--tls-certificate", certificate, "--tls-key", files.key("reader"))
    assert "is not the key of the certificate" in refused(*listen, *other)
    assert "has no certificates in PEM" in refused(*listen, *pair, "--tls-ca", __file__)
    garbage = tmp_path / "garbage"
    garbage.write_text("x")
    garbage.chmod(0o600)
    wrong = ("--tls-certificate", str(garbage), "--tls-key", str(garbage))
    assert "are not a certificate" in refused(*listen, *wrong)
    garbage.chmod(0o604)
    assert "chmod 600" in refused(*listen, *wrong)
    missing = ("--tls-certificate", "/nowhere", "--tls-key", key)
    assert "cannot read" in refused(*listen, *missing)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "names no user"),
        ("reader", "line 1: write USER:PASSWORD"),
        ("a:b\n\n:secret\n", "line 3: write USER:PASSWORD"),
        ("a:", "line 1: write USER:PASSWORD"),
        (" a:b", "line 1"),
        ("a:b\na:c", "line 2: the user 'a' is there twice"),
    ],
)
def test_files_of_users(tmp_path: Path, text: str, reason: str) -> None:
    users = tmp_path / "users"
    users.write_text(text)
    users.chmod(0o600)
    message = refused("--users", str(users))
    assert reason in message and "secret" not in message


def test_rules_need_to_know_the_clients(files: Files) -> None:
    by_user = AccessRule(users=("a",), may=frozenset({"read"}))
    by_certificate = AccessRule(certificates=("a",), may=frozenset({"read"}))
    assert "set --users or --tls-ca" in refused(rules=(by_user,))
    assert "an access rule names certificates" in refused(
        "--users", files.users, rules=(by_certificate,)
    )
    tls = ("--listen", TLS, *files.server_flags(), "--tls-ca", files.ca)
    assert "an access rule names users" in refused(*tls, rules=(by_user,))
    assert settings(*tls, rules=(by_certificate,)).rules == (by_certificate,)
    join = ("--connect", "tcp/127.0.0.1:1")
    assert "--listen only" in refused(*join, rules=(by_user,))
    assert "--listen only" in refused(*join, "--users", files.users)
    assert "--connect only" in refused("--user", "a")


def test_every_request_type_is_classified() -> None:
    """A new request type must be put among the reads or the writes, or nobody may use it."""
    assert {*READS, *KEYED, "hello"} == set(keys.REQUEST_TYPES)


@pytest.mark.parametrize(
    ("pattern", "chunk"),
    [("wheels", "wheels"), ("*", "*"), ("arm-*", "arm-$*"), ("", "%"), ("a/b*", "a%2Fb$*")],
)
def test_patterns_of_authorities(pattern: str, chunk: str) -> None:
    assert authority_chunk(pattern) == chunk


def test_rights_are_the_union_of_the_rules_that_match() -> None:
    rules = (
        AccessRule(may=frozenset({"read"})),
        AccessRule(users=("a",), publish=("x",)),
        AccessRule(users=("a", "b"), certificates=("c",), may=frozenset({"clear"})),
    )
    assert granted(rules, None, None) == {"may": ["read"], "publish": []}
    assert granted(rules, "a", None) == {"may": ["read"], "publish": ["x"]}
    assert granted(rules, "b", "c") == {"may": ["clear", "read"], "publish": []}


@pytest.mark.parametrize(
    ("listen", "users", "ca", "warns"),
    [
        (["tcp/127.0.0.1:1", "tcp/[::1]:1", "tcp/localhost:1"], False, False, None),
        (["unixsock-stream//run/x"], False, False, None),
        (["tcp/0.0.0.0:1"], False, False, "ANYONE WHO REACHES tcp/0.0.0.0:1 CAN"),
        (["tcp/[::]:1"], False, False, "ANYONE"),
        (["tcp/robot:1"], False, False, "ANYONE"),
        (["tls/0.0.0.0:1"], False, False, "--users"),
        (["tls/0.0.0.0:1"], True, False, None),
        (["tls/0.0.0.0:1"], False, True, None),
        (["tls/0.0.0.0:1", "tcp/0.0.0.0:2"], False, True, "ANYONE WHO REACHES tcp/0.0.0.0:2"),
        (["tcp/0.0.0.0:1"], True, False, "is not encrypted"),
        (["tcp/127.0.0.1:1"], True, False, None),
    ],
)
def test_the_warning(listen: list[str], users: bool, ca: bool, warns: str | None) -> None:
    given = Security(users="u" if users else None, tls_ca="c" if ca else None)
    warning = security.exposure(given, listen)
    assert warns is None if warning is None else warns is not None and warns in warning


def test_the_server_logs_the_warning(start_server: StartServer) -> None:
    assert "ANYONE" not in start_server().log
    public = start_server(endpoint=free_endpoint().replace("127.0.0.1", "0.0.0.0"))
    assert "WARNING" in public.log and "ANYONE WHO REACHES" in public.log


@pytest.mark.slow
def test_a_server_that_joins_a_secured_network(
    start_server: StartServer, files: Files, tmp_path: Path
) -> None:
    """It shows its own user, and learns why it is refused, without its password."""
    router = start_server("--users", files.users)
    password = tmp_path / "password"
    password.write_text("guessed\n")
    password.chmod(0o600)
    user = ("--user", "reader", "--password-file", str(password))
    shown = servers.refused("--connect", router.endpoint, *user, "--tree", "other")
    assert "guessed" not in shown and "refuses user 'reader'" in shown.splitlines()[-1]


def test_files_for_tls_need_an_encrypted_endpoint(files: Files) -> None:
    assert "is not encrypted" in refused("--connect", "tcp/127.0.0.1:1", "--tls-ca", files.ca)
    with pytest.raises(InvalidArgumentException, match="is not encrypted"):
        TransformClient.connect("tcp/127.0.0.1:1", credentials=Credentials(ca=files.ca))
