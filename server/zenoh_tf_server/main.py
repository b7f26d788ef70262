"""``zenoh-tf-server``: command-line flags, logging and signals."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import shlex
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import version

import uvloop

from zenoh_tf import keys, zenoh_config
from zenoh_tf.errors import TransformException

from . import limits
from .network import NetworkError
from .server import Server, Settings
from .tree_claim import TreeTaken

DEFAULT_LISTEN = "tcp/127.0.0.1:7447"
#: Exit status of a server that cannot start; the same as for wrong flags.
CANNOT_START = 2
#: A server stops within two seconds: a stop that takes longer than this is ended by force.
_STOP_TIMEOUT_S = 1.7

log = logging.getLogger("zenoh_tf.server")


def parser() -> argparse.ArgumentParser:
    flags = argparse.ArgumentParser(
        prog="zenoh-tf-server",
        description="Serve a transform tree over Zenoh.",
    )
    flags.add_argument("--version", action="version", version=f"%(prog)s {version('zenoh-tf')}")
    where = flags.add_mutually_exclusive_group()
    where.add_argument(
        "--listen",
        action="append",
        metavar="ENDPOINT",
        help="embed a Zenoh router that listens on this endpoint, PROTOCOL/HOST:PORT; repeatable "
        f"(default: {DEFAULT_LISTEN})",
    )
    where.add_argument(
        "--connect",
        action="append",
        metavar="ENDPOINT",
        help="join the Zenoh network at this endpoint as a client, and do not listen; repeatable",
    )
    _add_tree_flags(flags)
    flags.add_argument(
        "--workers",
        type=int,
        default=min(8, max(2, os.cpu_count() or 2)),
        metavar="N",
        help="threads that serve queries, per query family (default: %(default)s)",
    )
    flags.add_argument(
        "--log-level",
        choices=("debug", "info", "warning", "error"),
        default="info",
        help="lowest level of the messages logged to standard error (default: %(default)s)",
    )
    limits.add_flags(flags)
    return flags


def _add_tree_flags(flags: argparse.ArgumentParser) -> None:
    flags.add_argument("--tree", default="main", help="name of the tree (default: %(default)s)")
    flags.add_argument(
        "--cache-time",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="how long transforms are kept, counted back from the newest of their frame "
        "(default: %(default)s)",
    )
    flags.add_argument(
        "--concurrency",
        choices=("optimistic", "2pl", "giant"),
        default="optimistic",
        help="concurrency control of the tree (default: %(default)s)",
    )
    flags.add_argument(
        "--one-authority-per-frame",
        action="store_true",
        help="refuse transforms of a frame from a second authority, instead of counting conflicts",
    )
    flags.add_argument(
        "--time-jump",
        choices=("reject", "clear"),
        default="reject",
        help="what to do with a transform that is older than its frame's newest by more than the "
        "cache time. reject: drop it, because it is late. clear: simulated time was set back, so "
        "drop all but static transforms, then store it (default: %(default)s)",
    )


def main(arguments: Sequence[str] | None = None) -> int:
    flags = parser()
    options = flags.parse_args(arguments)
    _check(flags, options)
    logging.basicConfig(
        level=options.log_level.upper(),
        format="%(asctime)s %(levelname)-7s %(name)s: %(message)s",
        stream=sys.stderr,
    )
    settings = Settings(
        tree=options.tree,
        listen=options.listen or [DEFAULT_LISTEN],
        connect=options.connect or [],
        cache_time_s=options.cache_time,
        concurrency=options.concurrency,
        one_authority_per_frame=options.one_authority_per_frame,
        time_jump=options.time_jump,
        workers=options.workers,
        limits=limits.from_flags(options),
    )
    try:
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            runner.run(serve(settings))
    except (NetworkError, TreeTaken, TransformException) as error:
        print(f"zenoh-tf-server: {error}", file=sys.stderr)
        return CANNOT_START
    return 0


def _check(flags: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Exit with status 2 and a message if a flag's value is wrong."""
    if options.workers < 1:
        flags.error(f"--workers is {options.workers}: it must be at least 1")
    if not options.cache_time > 0:
        flags.error(f"--cache-time is {options.cache_time:g} s: it must be positive")
    try:
        keys.server(options.tree, "")
    except TransformException as error:
        flags.error(f"--tree: {error}")
    for flag in ("listen", "connect"):
        for endpoint in getattr(options, flag) or ():
            try:
                zenoh_config.check_endpoint(endpoint)
            except TransformException as error:
                flags.error(f"--{flag}: {error}")


async def serve(settings: Settings) -> None:
    """Serve until SIGINT or SIGTERM."""
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    starting = asyncio.ensure_future(asyncio.to_thread(Server, settings, loop))
    stopped = asyncio.ensure_future(stop.wait())
    await asyncio.wait({starting, stopped}, return_when=asyncio.FIRST_COMPLETED)
    if not starting.done():
        _leave("stopped before the start was complete")
    try:
        server = starting.result()
    except BaseException:
        stopped.cancel()
        raise
    print(_greeting(settings, server.instance), flush=True)
    await stopped
    log.info("stopping")
    try:
        await asyncio.wait_for(asyncio.to_thread(server.close), _STOP_TIMEOUT_S)
    except TimeoutError:
        _leave("the Zenoh session did not close in time: ending without closing it")
    log.info("stopped")


def _leave(reason: str) -> None:
    """End the process at once: Python cannot interrupt a thread that is inside Zenoh."""
    log.warning(reason)
    logging.shutdown()
    os._exit(0)


def _greeting(settings: Settings, instance: str) -> str:
    # Options of an endpoint are left out: with TLS they hold the private key's path.
    endpoints = [zenoh_config.address(each) for each in settings.connect or settings.listen]
    how = "joined" if settings.connect else "listens on"
    endpoint = shlex.quote(endpoints[0])
    return (
        f"zenoh-tf-server {version('zenoh-tf')} (instance {instance}) serves tree "
        f"{settings.tree!r}, {how} {', '.join(endpoints)}; try: "
        f"zenoh-tf --connect {endpoint} --tree {shlex.quote(settings.tree)} frames"
    )
