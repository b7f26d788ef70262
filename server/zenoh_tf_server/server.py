"""One running server: the Zenoh session and everything that is declared on it."""

from __future__ import annotations

import asyncio
import functools
import secrets
import time
from contextlib import ExitStack, closing
from typing import Any

import zenoh

from zenoh_tf import TransformTree, wire
from zenoh_tf._net import keys

from . import federation, motion_limits, ros2
from .federation.robot import RobotTree
from .ingest.foreign import Foreign
from .ingest.ingest import Ingest
from .ingest.put_commits import PutCommits
from .monitoring.event_reports import EventReports
from .process import network, sharing
from .process.sharing import Sharing
from .process.tree_claim import Claim
from .requests.guard import RequestGuard
from .requests.service import Service
from .requests.surroundings import Surroundings
from .settings import ServerSettings
from .state.state import StoredState
from .streams.interests import Interests
from .streams.snapshots import Snapshots
from .streams.stream import Stream
from .transport.clients import Clients
from .transport.running_server import RunningServer


class Server(RunningServer):
    """The server of a tree."""

    service: Service

    def __init__(self, settings: ServerSettings, loop: asyncio.AbstractEventLoop) -> None:
        """Serve. Raises NetworkError, StateError or TreeTaken."""
        instance = secrets.token_hex(8)
        limits = settings.limits
        # Closed in reverse order: first the queries, then the waiting lookups, then the session.
        with ExitStack() as stack:
            joined = bool(settings.connect)
            shared = Sharing(settings.sharing, settings.tree, instance, joined=joined)
            stack.callback(shared.close)
            tree = shared.make_tree(functools.partial(_make_tree, settings))
            tree._begin_startup(0, limits.startup_ms * 1_000_000)
            state = StoredState(settings.state, tree, settings.tree, limits)
            stack.callback(state.close)
            session = network.open_session(
                settings.listen,
                settings.connect,
                limits,
                settings.security,
                settings.tree,
                gossip=settings.ros2.enabled,
            )
            stack.callback(session.close)
            listens_since_s = time.monotonic()
            stack.callback(state.close)  # before the session, which may take long to close
            claim = stack.enter_context(closing(Claim(session, settings.tree, instance)))
            sharing.wait_for_predecessor(settings.sharing, listens_since_s)
            clients = Clients(limits.connections)
            stack.callback(clients.close)
            stream = Stream(tree, instance, limits)
            stack.callback(stream.close)
            interests = Interests(tree, stream, instance, limits)
            stack.callback(interests.close)
            clients.when_gone(interests.client_gone)
            snapshots = Snapshots(tree, stream, interests, instance, _settings_of(tree, settings))
            outgoing = ros2.publish(settings.ros2, session, tree, state.links, stack)
            robots: dict[str, RobotTree] = {}
            around = Surroundings(
                is_connected=clients.is_connected,
                addresses=functools.partial(network.addresses, session),
                lost_robots=functools.partial(federation.lost, robots),
                last_seq=stream.last_seq,
                on_commit=None if outgoing is None else outgoing.committed,
                offer=shared.start(tree, limits.as_dict()),
                reads={"snapshot": snapshots.snapshot, "missed": snapshots.missed},
            )
            service = _make_service(settings, loop, session, tree, state, instance, around)
            key = functools.partial(keys.request, settings.tree)
            super().__init__(session, service, clients, key, settings.workers, stack)
            stack.callback(service.close)
            commits = PutCommits(
                service.commit_puts,
                service.puts,
                service.refusals,
                limits,
                service.clocks,
                settings.future,
            )
            ingest = Ingest(commits, limits)
            stack.callback(ingest.close)
            stack.callback(shared.close)
            for starting in (stream, interests, ingest):
                starting.start(session, settings.tree)
            stack.callback(Foreign(session, ingest, limits, settings.ingest).close)
            incoming = ros2.receive(settings.ros2, session, ingest, state.links, limits, stack)
            for part in (stream, interests, outgoing, incoming):
                if part is not None:
                    service.add_counters(part.counters)
            federation.start(
                *(settings.federation, settings.security, service, ingest, session, stack, robots)
            )
            events = EventReports(tree, service.clocks)
            stack.callback(events.close)
            events.start()
            # Another router frees its own keys.
            self.serve(None if settings.connect else ingest.authorities)
            # Withdrawn first when it closes, so that clients learn of it.
            stack.callback(claim.close)
            claim.serve()
            self._stack = stack.pop_all()


def _settings_of(tree: TransformTree, settings: ServerSettings) -> wire.TreeSettings:
    """What a mirror makes its tree with."""
    limits, cache_ns = settings.limits, round(settings.cache_time_s * 1e9)
    return wire.TreeSettings(
        *(cache_ns, limits.frames, limits.samples_per_frame, limits.name_bytes, limits.depth),
        tree._motion_limits(),
    )


def _make_service(
    settings: ServerSettings,
    loop: asyncio.AbstractEventLoop,
    session: zenoh.Session,
    tree: TransformTree,
    state: StoredState,
    instance: str,
    around: Surroundings,
) -> Service:
    security = settings.security
    certificate_of = functools.partial(network.certificate_of, session)
    guard = RequestGuard(security.rules, admin=security.admin, certificate_of=certificate_of)
    return Service(
        tree,
        settings.tree,
        instance,
        settings.limits,
        loop,
        state.links,
        guard,
        settings.future,
        around,
    )


def _make_tree(settings: ServerSettings, **options: Any) -> TransformTree:
    limits = settings.limits
    tree = TransformTree(
        settings.cache_time_s,
        settings.concurrency,
        max_frames=limits.frames,
        max_samples_per_frame=limits.samples_per_frame,
        max_name_bytes=limits.name_bytes,
        max_depth=limits.depth,
        max_memory_bytes=limits.memory,
        one_authority_per_frame=settings.one_authority_per_frame,
        time_jump=settings.time_jump,
        max_log_bytes=limits.change_log_bytes,
        **options,
    )
    motion_limits.declare(tree, settings.motion_limits)
    return tree
