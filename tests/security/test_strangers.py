"""A client that is not let in gets the reason, and what to do about it."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from zenoh_tf.errors import (
    AccessDenied,
    InvalidArgumentException,
    ServerUnavailable,
    TransformException,
)
from zenoh_tf_client import Credentials, TransformClient
from zenoh_tf_client.session.links import opening

from .conftest import PASSWORDS, Files, Serve, connect, tls_endpoint

TIMEOUT_S = 1.5


@pytest.fixture(scope="module")
def by_user(serve: Serve, files: Files) -> ServerProcess:
    return serve(*files.server_flags(), "--users", files.users)


@pytest.fixture(scope="module")
def by_certificate(serve: Serve, files: Files) -> ServerProcess:
    return serve(*files.server_flags(), "--tls-ca", files.ca)


def failure(endpoint: str, credentials: Credentials) -> TransformException:
    with pytest.raises(TransformException) as caught:
        TransformClient.connect(endpoint, timeout_s=TIMEOUT_S, credentials=credentials).close()
    for password in PASSWORDS.values():
        assert password not in str(caught.value)
    return caught.value


def denied(endpoint: str, credentials: Credentials, *texts: str) -> None:
    error = failure(endpoint, credentials)
    assert type(error) is AccessDenied, error
    for text in (endpoint, *texts):
        assert text in str(error), error


def unavailable(endpoint: str, credentials: Credentials, *texts: str) -> None:
    error = failure(endpoint, credentials)
    assert type(error) is ServerUnavailable, error
    for text in (endpoint, *texts):
        assert text in str(error), error


def test_users_and_owners_of_certificates_are_let_in(
    by_user: ServerProcess, by_certificate: ServerProcess, files: Files
) -> None:
    for server, credentials in (
        (by_user, files.user("reader")),
        (by_certificate, files.owner("reader")),
    ):
        with connect(server, credentials) as tf:
            tf.clear()  # there are no rules, so all may do everything
            assert tf.frames() == []


def test_the_greeting_gives_no_command_that_would_be_refused(by_user: ServerProcess) -> None:
    assert by_user.greeting.endswith(f"listens on {by_user.endpoint}")


def test_wrong_passwords(by_user: ServerProcess, files: Files) -> None:
    for user in ("reader", "unknown"):
        wrong = Credentials(ca=files.ca, user=user, password=PASSWORDS["wheels"])
        denied(by_user.endpoint, wrong, f"refuses user '{user}'", "wrong password")


def test_no_user(by_user: ServerProcess, files: Files) -> None:
    denied(by_user.endpoint, Credentials(ca=files.ca), "wants a user", "ZENOH_TF_USER")


def test_no_ca(by_user: ServerProcess) -> None:
    denied(by_user.endpoint, Credentials(), "authority that this client does not know", "--tls-ca")


def test_another_ca(by_user: ServerProcess, files: Files) -> None:
    other = str(files.folder / "strangers/ca.pem")
    denied(by_user.endpoint, Credentials(ca=other), "not signed by any authority in", other)


def test_no_certificate(by_certificate: ServerProcess, files: Files) -> None:
    denied(by_certificate.endpoint, Credentials(ca=files.ca), "wants a client's certificate")


def test_a_stranger_s_certificate_with_the_name_of_a_client(
    by_certificate: ServerProcess, files: Files
) -> None:
    strangers = files.folder / "strangers"
    stranger = Credentials(
        files.ca, str(strangers / "reader.pem"), str(strangers / "reader-key.pem")
    )
    denied(by_certificate.endpoint, stranger, "refuses the certificate", "unknown ca")


def test_an_expired_certificate_of_a_client(by_certificate: ServerProcess, files: Files) -> None:
    denied(by_certificate.endpoint, files.owner("late"), "refuses the certificate", "expired")


def test_an_expired_certificate_of_the_server(serve: Serve, files: Files) -> None:
    server = serve(*files.server_flags("expired"), "--users", files.users)
    denied(server.endpoint, files.user("reader"), "has expired")


def test_a_certificate_for_another_name(serve: Serve, files: Files) -> None:
    server = serve(*files.server_flags("elsewhere"), "--users", files.users)
    denied(server.endpoint, files.user("reader"), "not for the name '127.0.0.1'")


def test_plain_against_tls(by_user: ServerProcess) -> None:
    plain = by_user.endpoint.replace("tls/", "tcp/")
    unavailable(plain, Credentials(), f"speaks TLS: connect to {by_user.endpoint}")


def test_tls_against_plain(server: ServerProcess, files: Files) -> None:
    plain = server.endpoint
    secure = plain.replace("tcp/", "tls/")
    unavailable(secure, Credentials(ca=files.ca), f"does not speak TLS: connect to {plain}")


def test_a_password_without_tls(start_server: StartServer, files: Files) -> None:
    server = start_server("--users", files.users)
    denied(server.endpoint, Credentials(), "wants a user")
    denied(server.endpoint, Credentials(user="reader", password="guess"), "refuses user 'reader'")
    with connect(server, Credentials(user="reader", password=PASSWORDS["reader"])) as tf:
        assert tf.frames() == []


def test_nothing_listens(files: Files) -> None:
    unavailable(free_endpoint(), Credentials(), "nothing listens")
    unavailable(tls_endpoint(), Credentials(ca=files.ca), "nothing listens")


@pytest.fixture
def silent_port() -> Iterator[str]:
    """A port that accepts connections and ends each after its first message."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            while True:
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                with connection:
                    connection.settimeout(2.0)
                    try:
                        connection.recv(1024)
                    except OSError:
                        continue

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp/127.0.0.1:{listener.getsockname()[1]}"
        listener.shutdown(socket.SHUT_RDWR)
    thread.join()


def test_something_else_listens(silent_port: str) -> None:
    unavailable(silent_port, Credentials(), "does not answer as Zenoh")


def test_a_server_without_room(start_server: StartServer) -> None:
    server = start_server("--limit", "connections=1")
    with server.connect():
        denied(server.endpoint, Credentials(), "--limit connections")


def test_a_frozen_server(start_server: StartServer, files: Files) -> None:
    server = start_server()
    server.freeze()
    unavailable(server.endpoint, Credentials(), "answers nothing", "stopped")
    secure = server.endpoint.replace("tcp/", "tls/")
    unavailable(secure, Credentials(ca=files.ca), "answers nothing", "stopped")


@pytest.mark.parametrize(
    ("parts", "field"),
    [
        ({"user": "a"}, "password"),
        ({"password": "a"}, "user"),
        ({"certificate": __file__}, "key"),
        ({"key": __file__}, "certificate"),
        ({"ca": "/nowhere/ca.pem"}, "ca"),
    ],
)
def test_incomplete_credentials(parts: dict[str, str], field: str) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        Credentials(**parts)
    assert caught.value.field == field


def test_files_that_are_no_certificates_or_no_pair_are_named(
    by_user: ServerProcess, files: Files
) -> None:
    pair = files.certificate("reader"), files.key("reader")
    for wrong, field in (
        (Credentials(ca=__file__), "ca"),
        (Credentials(files.ca, __file__, pair[1]), "certificate"),
        (Credentials(files.ca, pair[0], files.key("arm")), "key"),
    ):
        error = failure(by_user.endpoint, wrong)
        assert isinstance(error, InvalidArgumentException) and error.field == field
        assert str(getattr(wrong, field)) in str(error)


def test_passwords_are_not_shown(by_user: ServerProcess, files: Files) -> None:
    credentials = files.user("reader")
    assert PASSWORDS["reader"] not in repr(credentials) + str(credentials)
    with connect(by_user, credentials) as tf, tf.broadcaster("a") as broadcaster:
        for shown in (repr(tf), repr(broadcaster), repr(tf._connection)):
            assert PASSWORDS["reader"] not in shown


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return forks.run(
        [sys.executable, "-m", "zenoh_tf_tools", *arguments], timeout=150, env=environment
    )


def test_the_command_line(by_user: ServerProcess, files: Files, tmp_path: Path) -> None:
    password = tmp_path / "password"
    password.write_text(PASSWORDS["reader"] + "\n")
    password.chmod(0o600)
    endpoint = ("--connect", by_user.endpoint, "--timeout", "2s")
    user = ("--user", "reader", "--password-file", str(password))
    done = run(*endpoint, "--tls-ca", files.ca, *user, "frames")
    assert (done.returncode, done.stderr) == (0, "")
    done = run(*endpoint, "frames")
    assert done.returncode == 1 and done.stderr.startswith("zenoh-tf: AccessDenied: ")
    done = run(
        *endpoint,
        "frames",
        ZENOH_TF_CA=files.ca,
        ZENOH_TF_USER="reader",
        ZENOH_TF_PASSWORD=PASSWORDS["reader"],
    )
    assert (done.returncode, done.stderr) == (0, "")
    password.chmod(0o644)
    done = run(*endpoint, "--tls-ca", files.ca, *user, "frames")
    assert done.returncode == 1 and f"chmod 600 {password}" in done.stderr
    assert PASSWORDS["reader"] not in done.stdout + done.stderr


@pytest.mark.parametrize("several", [False, True])
def test_a_server_that_comes_up_while_a_client_tries(
    server: ServerProcess, monkeypatch: pytest.MonkeyPatch, several: bool
) -> None:
    """When the client looks for the reason, the server is there, as one that lets nobody in."""
    tries: list[str] = []
    try_endpoint = opening.try_endpoint

    def too_early(endpoint: str, *arguments: Any) -> zenoh.Session | None:
        tries.append(endpoint)
        return None if len(tries) <= len(endpoints) else try_endpoint(endpoint, *arguments)

    endpoints = [server.endpoint]
    if several:
        endpoints.append(server.endpoint.replace("127.0.0.1", "localhost"))
    monkeypatch.setattr(opening, "try_endpoint", too_early)
    with TransformClient.connect(endpoints if several else endpoints[0]) as tf:
        assert tf.frames() == []
    assert len(tries) == len(endpoints) + 1
