"""The second half of the image test: runs the services of compose.yaml with the server.

The entry points, commands and restrictions are those of compose.yaml. The services share the
server's network, since not every engine has a bridge; so the server's name becomes its address.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

import engines
from checks import expect, say, until

COMPOSE_FILE = Path(__file__).with_name("compose.yaml")
# The frames that exist once every sensor has published.
FRAMES = {"odom", "base_link", "wrist", "camera", "object"}


@contextlib.contextmanager
def compose_services(
    engine: engines.Engine, tag: str, server: str, outside: list[str]
) -> Iterator[None]:
    """Run the services during the block, which starts once the server has data of all sensors.

    ``outside`` is the command line of a client on this machine.
    """
    services = YAML(typ="safe").load(COMPOSE_FILE)["services"]
    names = {service: f"{server}-{service}" for service in services if service != "server"}
    try:
        for service, name in names.items():
            _start(engine, tag, name, server, services[service])

        def all_sensors_publish() -> bool:
            printed = engines.run([*outside, "--json", "frames"]).stdout
            return {record["name"] for record in json.loads(printed)["frames"]} >= FRAMES

        until(all_sensors_publish, 30, "not all sensors publish")
        until(lambda: "wrist" in engine.logs(names["client"]), 30, "the client shows no tree")
        for name in names.values():
            expect(engine.inspect(name)["State"]["Running"], f"{name} has ended")
        say("compose", f"{len(names)} services with the server, all sensors publish")
        yield
    except BaseException:
        for name in names.values():
            print(f"--- log of {name}\n{engine.logs(name)}---", file=sys.stderr)
        raise
    finally:
        for name in names.values():
            engine.remove(name)


def _start(
    engine: engines.Engine, tag: str, name: str, server: str, description: dict[str, Any]
) -> None:
    options = [f"--cap-drop={capability}" for capability in description["cap_drop"]]
    options += [f"--security-opt={option}" for option in description["security_opt"]]
    if description["read_only"]:
        options.append("--read-only")
    if description["healthcheck"]["disable"]:
        options.append("--no-healthcheck")
    program, *rest = [
        argument.replace("tcp/server:", "tcp/127.0.0.1:")
        for argument in [*description["entrypoint"], *description["command"]]
    ]
    options += [f"--volume={server}-{volume}" for volume in description["volumes"]]
    options += [f"--network=container:{server}", f"--entrypoint={program}"]
    engine.start(tag, name, *options, command=rest)
