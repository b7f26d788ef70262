"""The other half of the image test: the services of compose.yaml, run beside the server.

They run as compose.yaml says (entry point, command, restrictions), but in the server's network, so
that it works with an engine that has no bridge: only the server's name is replaced by its address.
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
# What the sensors publish between them: this frame is known once all of them are heard.
FRAMES = {"odom", "base_link", "wrist", "camera", "object"}


@contextlib.contextmanager
def compose_services(
    engine: engines.Engine, tag: str, server: str, outside: list[str]
) -> Iterator[None]:
    """Run the services during the block, which starts once all sensors are heard.

    ``outside`` is the command line of a client on this machine.
    """
    services = YAML(typ="safe").load(COMPOSE_FILE)["services"]
    names = {service: f"{server}-{service}" for service in services if service != "server"}
    try:
        for service, name in names.items():
            _start(engine, tag, name, server, services[service])

        def heard() -> bool:
            told = engines.run([*outside, "--json", "frames"]).stdout
            return {record["name"] for record in json.loads(told)["frames"]} >= FRAMES

        until(heard, 30, "the sensors are not all heard")
        until(lambda: "wrist" in engine.logs(names["client"]), 30, "the client shows no tree")
        for name in names.values():
            expect(engine.inspect(name)["State"]["Running"], f"{name} has ended")
        say("compose", f"{len(names)} services beside the server, all sensors heard")
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
    options += [f"--network=container:{server}", f"--entrypoint={program}"]
    engine.start(tag, name, *options, command=rest)
