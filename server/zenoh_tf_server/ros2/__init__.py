"""ROS 2 in and out (``--ros2``, ``--ros2-publish``).

`settings` has the flags, `incoming` adds messages to the put queues, with the prefixes of
`ingest/prefixes.py` on their frames, `zenoh_tf.ros2.publishers` finds whose they
are, `histories` asks publishers for what they keep for late subscribers, `statics` merges what they
have sent on `/tf_static`, and `outgoing` publishes.
"""

from __future__ import annotations

import logging
from contextlib import ExitStack

import zenoh

from zenoh_tf.ros2 import attachment

from ..ingest.ingest import Ingest
from ..limits import Limits
from ..requests.service import Service
from ..state.static_links import StaticLinks
from .incoming import Incoming
from .outgoing import Outgoing
from .settings import Ros2Settings

log = logging.getLogger("zenoh_tf.server.ros2")


def start(
    settings: Ros2Settings,
    session: zenoh.Session,
    service: Service,
    ingest: Ingest,
    links: StaticLinks,
    limits: Limits,
    stack: ExitStack,
) -> None:
    """Join the ROS 2 network of a session, until the stack is closed."""
    if settings.receive and not attachment.HAS_GIDS:
        log.warning(
            "the package xxhash is missing: publishers are known by their topic and session only, "
            "not by their id; install zenoh-tf with the extra ros2"
        )
    if settings.publish:
        outgoing = Outgoing(session, service.tree, links, settings)
        stack.callback(outgoing.close)
        service.on_commit = outgoing.committed
        service.add_counters(outgoing.counters)
    if settings.receive:
        incoming = Incoming(session, ingest, links, limits, settings)
        stack.callback(incoming.close)
        service.add_counters(incoming.counters)
