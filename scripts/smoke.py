"""Check an installed zenoh-tf: import, version, a lookup, and a server and a client as commands.

Run it by the environment's own Python, isolated and outside the source tree:
``cd / && ENVIRONMENT/bin/python -I .../scripts/smoke.py VERSION``.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import socket
import subprocess
import sys
from pathlib import Path

import zenoh_tf
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

ROOT = Path(__file__).resolve().parent.parent
COMMANDS = Path(sys.executable).parent
TIMEOUT_S = 60.0


def check(condition: bool, what: str) -> None:
    """End the program with `what` unless `condition` is true."""
    if not condition:
        raise SystemExit(f"smoke test: {what}")


def check_installation(version: str) -> None:
    """The package comes from the environment, not from the source tree, and has `version`."""
    location = Path(zenoh_tf.__file__).resolve()
    check(location.is_relative_to(Path(sys.prefix).resolve()), f"zenoh_tf comes from {location}")
    found = importlib.metadata.version("zenoh-tf")
    check(found == version, f"the installed version is {found}, not {version}")
    description = importlib.metadata.metadata("zenoh-tf").json["description"]
    check("](docs/" not in description, "the description has links relative to the repository")


def check_tree() -> None:
    """An embedded tree interpolates between two samples."""
    tree = TransformTree()
    for stamp_ns, x in ((0, 0.0), (1_000_000, 1.0)):
        pose = Transform(translation=(x, 0.0, 0.0))
        tree.set_transform(StampedTransform("map", "base", stamp_ns, pose))
    x = tree.lookup_transform("map", "base", 500_000).transform.translation[0]
    check(math.isclose(x, 0.5), f"the embedded tree answers x = {x} halfway from 0 to 1")


def check_network() -> None:
    """The installed server answers the installed command line and a client."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    server = subprocess.Popen(
        [COMMANDS / "zenoh-tf-server", "--listen", endpoint], stdout=subprocess.PIPE, text=True
    )
    try:
        assert server.stdout is not None
        check(bool(server.stdout.readline()), "the server did not start")
        run = [str(COMMANDS / "zenoh-tf"), "--connect", endpoint, "--timeout", "20s", "--json"]
        for arguments in ("set map base 1 2 3", "lookup map base"):
            answer = subprocess.run(
                [*run, *arguments.split()],
                stdout=subprocess.PIPE,
                text=True,
                check=True,
                timeout=TIMEOUT_S,
            )
            json.loads(answer.stdout)
        with TransformClient.connect(endpoint, timeout_s=20.0) as client:
            pose = client.lookup_latest_transform_xact("map", "base").transform
            check(list(pose.translation) == [1.0, 2.0, 3.0], f"the server answers {pose}")
    finally:
        server.terminate()
        status = server.wait(TIMEOUT_S)
    check(status == 0, f"the server ended with status {status}")


def main() -> None:
    """Run all checks."""
    check(not Path.cwd().is_relative_to(ROOT), f"run this outside {ROOT}")
    os.environ.pop("ZENOH_TF_CONNECT", None)
    check_installation(sys.argv[1])
    check_tree()
    check_network()
    print(f"ok: zenoh-tf {sys.argv[1]} on Python {sys.version.split()[0]}")


if __name__ == "__main__":
    main()
