"""The example of docker/compose-tls.yaml, run without containers: its files, rules and commands."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from tests.conftest import StartServer
from tests.processes import forks

from .conftest import tls_endpoint

DOCKER = Path(__file__).resolve().parents[2] / "docker"
FOLDER = "/etc/zenoh-tf"


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    text = (DOCKER / "compose-tls.yaml").read_text()
    found: dict[str, Any] = YAML(typ="safe").load(text)["services"]
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder `docker`, after the command in the head of the example."""
    folder = tmp_path_factory.mktemp("docker")
    shutil.copy(DOCKER / "server-tls.toml", folder)
    text = (DOCKER / "compose-tls.yaml").read_text()
    (line,) = (line for line in text.splitlines() if "certificates.sh" in line)
    script, made, *names = shlex.split(line.strip("# "))
    command = [str(DOCKER.parent / script), str(folder / Path(made).name), *names]
    subprocess.run(command, check=True, capture_output=True, timeout=150)
    return folder


def test_every_file_is_mounted_from_one_that_exists(services: dict[str, Any], folder: Path) -> None:
    for name, service in services.items():
        mounted = dict(volume.split(":")[1::-1] for volume in service["volumes"])
        assert "ca-key.pem" not in str(mounted)
        for source in mounted.values():
            assert (folder / source).is_file(), (name, source)
        for variable in ("ZENOH_TF_CA", "ZENOH_TF_CERTIFICATE", "ZENOH_TF_KEY"):
            assert service["environment"][variable] in mounted, (name, variable)


def test_the_services_work_together(
    services: dict[str, Any], folder: Path, start_server: StartServer
) -> None:
    entrypoint = services["server"]["entrypoint"]
    assert entrypoint == ["zenoh-tf-server", "--config", f"{FOLDER}/server-tls.toml"]
    # The certificate is for the names "server" and "localhost".
    endpoint = tls_endpoint().replace("127.0.0.1", "localhost")
    server = start_server("--config", str(folder / "server-tls.toml"), endpoint=endpoint)
    assert "ANYONE" not in server.log

    def run(service: str, *command: str) -> subprocess.CompletedProcess[str]:
        environment = {
            variable: str(value).replace(FOLDER, str(folder))
            for variable, value in services[service]["environment"].items()
        }
        return forks.run(
            [sys.executable, "-m", *command],
            env={"PATH": os.environ["PATH"], **environment, "ZENOH_TF_CONNECT": endpoint},
            timeout=150,
        )

    def command_of(service: str) -> list[str]:
        """What the service repeats: `while sleep N; do zenoh-tf ...; done`."""
        (loop,) = services[service]["command"]
        return ["zenoh_tf_tools", *shlex.split(loop.split(";")[1])[2:]]

    for service in ("sensor", "screen"):
        done = run(service, *command_of(service))
        assert done.returncode == 0, done.stderr
    assert "base" in done.stdout
    done = run("server", "zenoh_tf_tools.health")
    assert done.returncode == 0, done.stderr
    for service, command in (("screen", "clear"), ("sensor", "frames")):
        done = run(service, "zenoh_tf_tools", command)
        assert done.returncode == 1 and "AccessDenied" in done.stderr, done.stderr
