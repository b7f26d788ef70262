"""Real servers with TLS and users: certificates of an authority of the tests' own."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import trustme

from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.certificates import issue
from zenoh_tf_client import Credentials, TransformClient
from zenoh_tf_client.session.mapped_tree import Mode

CLIENTS = (
    *("reader", "listener", "wheels", "arm"),
    *("cleaner", "resetter", "remover", "admin", "nobody"),
)
PASSWORDS = {name: f"secret-of-{name}" for name in CLIENTS}


@dataclass(frozen=True)
class Files:
    """The folder with all certificates, keys and the users' file."""

    folder: Path

    def certificate(self, name: str) -> str:
        return str(self.folder / f"{name}.pem")

    def key(self, name: str) -> str:
        return str(self.folder / f"{name}-key.pem")

    @property
    def ca(self) -> str:
        return str(self.folder / "ca.pem")

    @property
    def users(self) -> str:
        return str(self.folder / "users")

    def server_flags(self, name: str = "server") -> list[str]:
        return ["--tls-certificate", self.certificate(name), "--tls-key", self.key(name)]

    def user(self, name: str) -> Credentials:
        """The credentials of a user with a password."""
        return Credentials(ca=self.ca, user=name, password=PASSWORDS[name])

    def owner(self, name: str) -> Credentials:
        """The credentials of the owner of a client's certificate."""
        return Credentials(ca=self.ca, certificate=self.certificate(name), key=self.key(name))


def tls_endpoint() -> str:
    return free_endpoint().replace("tcp/", "tls/")


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("certificates")
    authority = trustme.CA()
    now = datetime.datetime.now(datetime.timezone.utc)
    past = now - datetime.timedelta(9), now - datetime.timedelta(2)
    issue(authority, folder, "server", ["127.0.0.1", "localhost"])
    issue(authority, folder, "arm-server", ["127.0.0.1"])
    issue(authority, folder, "elsewhere", ["other.example"])
    issue(authority, folder, "expired", ["127.0.0.1"], *past)
    for name in PASSWORDS:
        issue(authority, folder, name)
    issue(authority, folder, "late", [], *past)
    issue(trustme.CA(), folder / "strangers", "reader")
    users = folder / "users"
    users.write_text("".join(f"{name}:{password}\n" for name, password in PASSWORDS.items()))
    users.chmod(0o600)
    return Files(folder)


Serve = Callable[..., ServerProcess]


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """``serve(*flags, endpoint=...)``: a server, stopped after the module's tests."""
    running: list[ServerProcess] = []

    def start(*flags: str, endpoint: str | None = None) -> ServerProcess:
        log = tmp_path_factory.mktemp("log") / "server.log"
        running.append(ServerProcess(log, endpoint or tls_endpoint(), "main", flags))
        return running[-1]

    yield start
    for server in running:
        server.stop()


def connect(
    server: ServerProcess, credentials: Credentials, timeout_s: float = 10.0, reads: Mode = "query"
) -> TransformClient:
    return TransformClient.connect(
        server.endpoint, "main", timeout_s, credentials=credentials, reads=reads
    )
