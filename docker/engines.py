"""The container engines of the image test: Docker, or buildah and podman without a daemon.

Both are used through their command lines, which are nearly the same.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import stand_in

_DEBIAN_PACKAGES = ("buildah", "podman", "runc", "mmdebstrap")


class Engine:
    """Docker. Requires a running daemon, and a registry unless the base image is present."""

    name = "docker"
    tool: tuple[str, ...] = ("docker",)

    def prepare_base(self, image: str) -> str:
        """Make ``image`` available under its name; return where it came from."""
        if self._run("image", "inspect", image, check=False).returncode == 0:
            return "already present"
        self._run("pull", "--quiet", image)
        return "pulled"

    def build(self, context: Path, dockerfile: Path, tag: str) -> None:
        self._run("build", "-f", str(dockerfile), "-t", tag, str(context))

    def start(self, tag: str, name: str, *options: str, command: Sequence[str] = ()) -> None:
        """Start a container in the background; ``command`` follows its entry point."""
        self._run("run", "-d", "--name", name, *options, tag, *command)

    def publish(self, port: int) -> list[str]:
        """Options of ``start`` that make the container's port reachable from this machine."""
        return ["-p", f"127.0.0.1::{port}"]

    def reach(self, name: str, port: int) -> tuple[list[str], str]:
        """Return how this machine reaches the port: a prefix of commands, and the endpoint."""
        ports = self.inspect(name)["NetworkSettings"]["Ports"][f"{port}/tcp"]
        return [], f"tcp/127.0.0.1:{ports[0]['HostPort']}"

    def is_healthy(self, name: str) -> bool:
        """Return the result of the image's own health check."""
        return bool(self.inspect(name)["State"]["Health"]["Status"] == "healthy")

    def execute(self, name: str, *command: str) -> subprocess.CompletedProcess[str]:
        return self._run("exec", name, *command, check=False)

    def run_once(
        self, tag: str, *options: str, command: Sequence[str]
    ) -> subprocess.CompletedProcess[str]:
        """Run a container to its end."""
        return self._run("run", "--rm", *options, tag, *command, check=False)

    def signal(self, name: str, signal: str) -> None:
        self._run("kill", "--signal", signal, name)

    def inspect(self, name: str) -> Any:
        return json.loads(self._run("inspect", name).stdout)[0]

    def logs(self, name: str) -> str:
        done = self._run("logs", name, check=False)
        return done.stdout + done.stderr

    def remove(self, name: str) -> None:
        self._run("rm", "-f", name, check=False)

    def remove_volume(self, name: str) -> None:
        self._run("volume", "rm", "-f", name, check=False)

    def close(self, tag: str) -> None:
        """Remove everything that the test made."""
        self._run("rmi", "-f", tag, check=False)

    def _run(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        return run([*self.tool, *arguments], check=check)


class Podman(Engine):
    """buildah and podman, as root, with their own store: no daemon, no change to the machine."""

    name = "buildah and podman"
    tool = ("podman", "--log-level=fatal")

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="zenoh-tf-image-"))
        storage = self._folder / "storage.conf"
        storage.write_text(
            "[storage]\n"
            'driver = "overlay"\n'
            f'graphroot = "{self._folder}/graph"\n'
            f'runroot = "{self._folder}/run"\n'
        )
        containers = self._folder / "containers.conf"
        # Limits that are granted inside another container, too; cgroups without systemd.
        containers.write_text(
            "[containers]\n"
            'default_ulimits = ["nofile=1024:4096", "nproc=1024:4096"]\n'
            "[engine]\n"
            'runtime = "runc"\n'
            'cgroup_manager = "cgroupfs"\n'
            'events_logger = "file"\n'
        )
        os.environ["CONTAINERS_STORAGE_CONF"] = str(storage)
        os.environ["CONTAINERS_CONF"] = str(containers)

    def prepare_base(self, image: str) -> str:
        local = f"localhost/{image}"
        remote = f"docker.io/library/{image}"
        if self._run("pull", "--quiet", remote, check=False).returncode == 0:
            self._run("tag", remote, local)
            return "pulled"
        self._run("import", str(stand_in.tarball(image)), local)
        return (
            "A STAND-IN made of Debian packages and this machine's Python, as no registry answers"
        )

    def build(self, context: Path, dockerfile: Path, tag: str) -> None:
        options = [
            "--pull-never",
            "--isolation",
            "chroot",
            "--network",
            "host",
            "--format",
            "docker",
        ]
        command = ["buildah", "bud", *options, "-f", str(dockerfile), "-t", tag, str(context)]
        run(command)

    def publish(self, port: int) -> list[str]:
        # A network with only a loopback interface needs no bridge and no port of this machine.
        return ["--network", "none"]

    def reach(self, name: str, port: int) -> tuple[list[str], str]:
        pid = self.inspect(name)["State"]["Pid"]
        return ["nsenter", f"--net=/proc/{pid}/ns/net"], f"tcp/127.0.0.1:{port}"

    def is_healthy(self, name: str) -> bool:
        # Without systemd no timer runs the image's check, so run it once.
        return self._run("healthcheck", "run", name, check=False).returncode == 0

    def close(self, tag: str) -> None:
        run(["buildah", "rm", "--all"], check=False)
        run(["buildah", "rmi", "--all", "--force"], check=False)
        run(["umount", str(self._folder / "graph" / "overlay")], check=False)
        shutil.rmtree(self._folder, ignore_errors=True)


def choose() -> Engine:
    """Return Docker if its daemon answers, else buildah and podman, which root may install."""
    if shutil.which("docker") and run(["docker", "info"], check=False).returncode == 0:
        return Engine()
    if os.geteuid() != 0:
        raise SystemExit("no Docker daemon answers; without one, building an image needs root")
    missing = [tool for tool in _DEBIAN_PACKAGES if shutil.which(tool) is None]
    if missing:
        if shutil.which("apt-get") is None:
            raise SystemExit(f"no Docker daemon answers; install {', '.join(missing)}")
        print(f"no Docker daemon answers: installing {', '.join(missing)}", flush=True)
        run(["apt-get", "update", "-qq"])
        install = ["apt-get", "install", "-y", "-qq", "--no-install-recommends"]
        run(["env", "DEBIAN_FRONTEND=noninteractive", *install, *missing])
    return Podman()


def run(command: list[str], *, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run a command; if it fails and ``check`` is set, fail the test with its output."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if check and done.returncode != 0:
        output = (done.stdout + done.stderr)[-8000:]
        raise SystemExit(f"failed with {done.returncode}: {' '.join(command)}\n{output}")
    return done
