"""``zenoh-tf-server``: logging, signals and the process's end."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import shlex
import signal
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import NoReturn

import uvloop

from zenoh_tf._net import zenoh_config
from zenoh_tf._zenoh.receive_threads import set_receive_threads
from zenoh_tf.errors import TransformException
from zenoh_tf.mirrors.free_memory import set_up_heaps
from zenoh_tf.text import printable

from . import capacity, flags
from .monitoring import logs
from .monitoring.metrics import MetricsMissing
from .monitoring.monitoring import Monitoring
from .process.network import NetworkError
from .process.tree_claim import TreeTaken
from .replica.server import ReplicaServer
from .security import settings as security
from .server import Server
from .settings import ServerSettings
from .state.file import StateError
from .transport.running_server import RunningServer

#: Exit status of a server that cannot start; the same as for wrong flags.
CANNOT_START = 2
#: A server stops within two seconds, of which the signal's delivery under load may use some. A stop
#: that lasts longer than this is ended by force.
_STOP_TIMEOUT_S = 1.2

#: How long a thread may keep the interpreter while others wait for it. A single lookup needs it
#: several times, and beside long requests waits as long each time; the default is 5 ms.
_SWITCH_INTERVAL_S = 0.0005

log = logging.getLogger("zenoh_tf.server")


def main(arguments: Sequence[str] | None = None) -> int:
    settings = flags.settings(flags.parse(arguments))
    logs.setup(settings.logs)
    warning = None if settings.connect else security.exposure(settings.security, settings.listen)
    if warning is not None:
        log.warning(warning)
    set_receive_threads()
    set_up_heaps()
    capacity.allow_open_files()
    try:
        uvloop.run(serve(settings))
    except (NetworkError, MetricsMissing, StateError, TreeTaken, TransformException) as error:
        print(printable(f"zenoh-tf-server: {error}"), file=sys.stderr)
        return CANNOT_START


async def serve(settings: ServerSettings) -> NoReturn:
    """Serve until SIGINT or SIGTERM, then end the process."""
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    monitoring = Monitoring(settings.metrics, settings.limits)
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    kind: Callable[..., RunningServer] = ReplicaServer if settings.replica_of else Server
    starting = asyncio.ensure_future(asyncio.to_thread(kind, settings, loop))
    stopped = asyncio.ensure_future(stop.wait())
    await asyncio.wait({starting, stopped}, return_when=asyncio.FIRST_COMPLETED)
    if not starting.done():
        log.warning("stopped before the start was complete")
        _end()
    try:
        server = starting.result()
    except BaseException:
        stopped.cancel()
        raise
    # A long reply with errors causes a full garbage collection, in which no thread can run. With
    # the modules, which are loaded now and stay, it takes 7 to 20 ms; without them under 1.
    gc.freeze()
    print(_greeting(settings, server.service.instance), flush=True)
    if not settings.replica_of:
        log.info(capacity.report(settings.limits, settings.cache_time_s))
    monitoring.serving(server)
    await stopped
    log.info("stopping")
    monitoring.stopping()
    try:
        await asyncio.wait_for(asyncio.to_thread(server.close), _STOP_TIMEOUT_S)
        log.info("stopped")
    except asyncio.TimeoutError:  # on Python 3.10 not yet the built-in one
        log.warning("the Zenoh session did not close in time: ending without closing it")
    _end()


def _end() -> NoReturn:
    """End the process at once, with status 0.

    An ordinary exit would wait for threads that are inside Zenoh, and abort the process when one
    of them returns to an interpreter that is gone.
    """
    logging.shutdown()
    sys.stdout.flush()
    os._exit(0)


def _greeting(settings: ServerSettings, instance: str) -> str:
    # Options of an endpoint are left out: with TLS they hold the private key's path.
    endpoints = [zenoh_config.address(each) for each in settings.connect or settings.listen]
    how = "joined" if settings.connect else "listens on"
    if settings.replica_of:
        primary = ", ".join(map(zenoh_config.address, settings.replica_of))
        how = f"as a replica of the one at {primary}, {how}"
    greeting = (
        f"zenoh-tf-server {version('zenoh-tf')} (instance {instance}) serves tree "
        f"{settings.tree!r}, {how} {', '.join(endpoints)}"
    )
    if not settings.security.is_open:
        return greeting  # the server does not know the files and names that a client would use
    command = ("zenoh-tf", "--connect", endpoints[0], "--tree", settings.tree, "frames")
    return f"{greeting}; try: {shlex.join(command)}"
