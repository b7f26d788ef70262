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
from .ingest.ingest import Ingest
from .ingest.put_commits import PutCommits
from .monitoring.event_reports import EventReports
from .process import network, sharing
from .process.sharing import Sharing
from .process.tree_claim import Claim
from .requests.guard import RequestGuard
from .requests.service import Service
from .settings import ServerSettings
from .state.state import State
from .streams.interests import Interests
from .streams.snapshots import Snapshots
from .streams.stream import Stream
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
            state = State(settings.state, tree, settings.tree, limits)
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
            service = _make_service(settings, loop, session, tree, state, instance)
            key = functools.partial(keys.request, settings.tree)
            super().__init__(session, service, key, settings.workers, stack)
            self._start_stream(settings, stack)
            stack.callback(service.close)
            service.waiters.is_connected = self.clients.is_connected
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
            sharing.wait_for_predecessor(settings.sharing, listens_since_s)
            service.offer = shared.start(tree, limits.as_dict())
            stack.callback(shared.close)
            ingest.start(session, settings.tree)
            ros2.start(settings.ros2, session, service, ingest, state.links, limits, stack)
            robots = settings.federation
            federation.start(robots, settings.security, service, ingest, session, stack)
            events = EventReports(tree, service.clocks)
            stack.callback(events.close)
            events.start()
            # Another router frees its own keys.
            self.serve(None if settings.connect else ingest.authorities)
            # Withdrawn first when it closes, so that clients learn of it.
            stack.callback(claim.close)
            claim.serve()
            self._stack = stack.pop_all()

    def _start_stream(self, settings: ServerSettings, stack: ExitStack) -> None:
        """Publish what commits change, and answer what mirrors ask."""
        tree, limits, instance = self.service.tree, settings.limits, self.service.instance
        stream = Stream(tree, instance, limits)
        stack.callback(stream.close)
        stream.start(self.session, settings.tree)
        self.service.add_counters(stream.counters)
        self.service.last_seq = stream.last_seq
        interests = Interests(tree, stream, instance, limits)
        stack.callback(interests.close)
        interests.start(self.session, settings.tree)
        self.service.add_counters(interests.counters)
        self.clients.when_gone(interests.client_gone)
        cache_ns = round(settings.cache_time_s * 1e9)
        tree_settings = wire.TreeSettings(
            *(cache_ns, limits.frames, limits.samples_per_frame, limits.name_bytes, limits.depth),
            tree._motion_limits(),
        )
        snapshots = Snapshots(tree, stream, interests, instance, tree_settings)
        self.service.add_reads({"snapshot": snapshots.snapshot, "missed": snapshots.missed})


def _make_service(
    settings: ServerSettings,
    loop: asyncio.AbstractEventLoop,
    session: zenoh.Session,
    tree: TransformTree,
    state: State,
    instance: str,
) -> Service:
    security = settings.security
    certificate_of = functools.partial(network.certificate_of, session)
    guard = RequestGuard(security.rules, admin=security.admin, certificate_of=certificate_of)
    service = Service(
        tree,
        settings.tree,
        instance,
        settings.limits,
        loop,
        state.links,
        guard,
        settings.future,
    )
    service.info_requests.addresses = functools.partial(network.addresses, session)
    return service


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
