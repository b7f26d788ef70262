"""Builds the container image, runs it without privileges, and uses it from outside.

``make image-test`` calls it. It uses Docker if its daemon answers, else buildah and podman.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import engines
from checks import expect, say, until
from compose_check import compose_services

ROOT = Path(__file__).resolve().parent.parent
DOCKERFILE = ROOT / "docker/Dockerfile"
TAG = "localhost/zenoh-tf:test"
NAME = "zenoh-tf-image-test"
PORT = 7447
USER_ID = 10001
STOP_TIME_MAX_S = 2.0

#: The volume of compose.yaml, by the name that compose_check gives it.
SOCKETS = f"--volume={NAME}-sockets:/run/zenoh-tf"
LOCKED_DOWN = ("--read-only", "--cap-drop=ALL", "--security-opt=no-new-privileges")


def main() -> int:
    """Run all checks; one that fails raises SystemExit with the reason."""
    engine = engines.choose()
    say("engine", engine.name)
    try:
        build(engine)
        check_contents(engine)
        engine.start(TAG, NAME, *LOCKED_DOWN, SOCKETS, *engine.publish(PORT))
        try:
            check_health(engine)
            check_privileges(engine)
            outside = outside_client(engine)
            check_outside_client(outside)
            check_shared_reads(engine)
            with compose_services(engine, TAG, NAME, outside):
                check_frozen_is_unhealthy(engine)
                check_stop(engine)
        except BaseException:
            print(f"--- log of the container\n{engine.logs(NAME)}---", file=sys.stderr)
            raise
        finally:
            engine.remove(NAME)
            engine.remove_volume(f"{NAME}-sockets")
    finally:
        engine.close(TAG)
    print("image test passed")
    return 0


def build(engine: engines.Engine) -> None:
    base = DOCKERFILE.read_text().split("ARG BASE_IMAGE=")[1].split()[0]
    say("base image", f"{base}: {engine.prepare_base(base)}")
    start = time.monotonic()
    engine.build(ROOT, DOCKERFILE, TAG)
    say("built", f"in {time.monotonic() - start:.0f} s")
    total, base_size = (engine.inspect(image)["Size"] / 1e6 for image in (TAG, base))
    say("size", f"{total:.0f} MB, of which {base_size:.0f} MB are the base image")


def check_contents(engine: engines.Engine) -> None:
    tools = "c++ g++ gcc cc clang cmake ninja"
    found = engine.run_once(TAG, "--entrypoint=sh", command=["-c", f"command -v {tools}; true"])
    expect(found.returncode == 0 and not found.stdout, f"build tools in the image: {found}")
    say("no compiler", "in the final image")
    configured = engine.inspect(TAG)["Config"]
    expect(configured["User"].split(":")[0] not in ("", "0", "root"), "the image runs as root")


def check_health(engine: engines.Engine) -> None:
    start = time.monotonic()
    until(lambda: engine.is_healthy(NAME), 60, "the container does not become healthy")
    say("healthy", f"seen {time.monotonic() - start:.1f} s after the start")


def check_privileges(engine: engines.Engine) -> None:
    status = engine.execute(NAME, "cat", "/proc/1/status").stdout
    facts = dict(line.split(":", 1) for line in status.splitlines())
    expect(facts["Uid"].split() == [str(USER_ID)] * 4, f"runs with uids {facts['Uid']}")
    for kind in ("CapPrm", "CapEff", "CapBnd"):
        expect(int(facts[kind], 16) == 0, f"has capabilities: {kind} {facts[kind]}")
    touched = engine.execute(NAME, "touch", "/opt/zenoh-tf/touched", "/touched")
    expect(touched.returncode != 0, "the root file system can be written")
    say("uid", f"{USER_ID}, no capabilities, read-only")


def outside_client(engine: engines.Engine) -> list[str]:
    """Return the command line of a client on this machine, up to the command."""
    prefix, endpoint = engine.reach(NAME, PORT)
    return [*prefix, str(Path(sys.executable).with_name("zenoh-tf")), "--connect", endpoint]


def check_outside_client(outside: list[str]) -> None:
    """Set a transform in one process of this machine, and look it up in another."""
    engines.run([*outside, "set", "map", "image_test", "1", "2", "3"])
    answer = engines.run([*outside, "--json", "lookup", "map", "image_test"]).stdout
    expect(json.loads(answer)["translation"] == [1.0, 2.0, 3.0], f"the lookup answers {answer}")
    say("outside client", f"set and looked up: {' '.join(outside)}")


def check_shared_reads(engine: engines.Engine) -> None:
    """Check that a client in another container reads the server's memory."""
    script = (
        "from zenoh_tf_client import TransformClient as Client\n"
        f"with Client.connect('tcp/127.0.0.1:{PORT}') as tf:\n"
        "    print(tf.reads, tf.lookup_transform('map', 'image_test').transform.translation[2])\n"
    )
    where = (*LOCKED_DOWN, SOCKETS, f"--network=container:{NAME}", "--entrypoint=python")
    done = engine.run_once(TAG, *where, command=["-c", script])
    expect(done.stdout.split() == ["shared", "3.0"], f"a second container reads: {done}")
    say("second container", "reads the server's memory")


def check_frozen_is_unhealthy(engine: engines.Engine) -> None:
    """Check that a server that runs but does not answer is unhealthy."""
    check = engine.inspect(NAME)["Config"]["Healthcheck"]["Test"][1:]
    engine.signal(NAME, "STOP")
    frozen = engine.execute(NAME, *check)
    engine.signal(NAME, "CONT")
    expect(frozen.returncode == 1, f"a frozen server counts as healthy: {frozen}")
    until(
        lambda: engine.execute(NAME, *check).returncode == 0,
        30,
        "the server stays unhealthy after the freeze",
    )
    say("health check", f"detects a frozen server: {frozen.stderr.strip()}")


def check_stop(engine: engines.Engine) -> None:
    engine.signal(NAME, "TERM")
    start = time.monotonic()
    until(lambda: not engine.inspect(NAME)["State"]["Running"], 30, "the server ignores SIGTERM")
    stop_time_s = time.monotonic() - start
    code = engine.inspect(NAME)["State"]["ExitCode"]
    expect(code == 0, f"ends with {code} on SIGTERM")
    expect(stop_time_s <= STOP_TIME_MAX_S, f"takes {stop_time_s:.1f} s to stop")
    say("stopped", f"{stop_time_s:.2f} s after SIGTERM while sensors publish, exit code 0")


if __name__ == "__main__":
    sys.exit(main())
