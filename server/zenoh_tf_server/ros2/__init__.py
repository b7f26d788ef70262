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

from zenoh_tf import TransformTree
from zenoh_tf.ros2 import attachment

from ..ingest.ingest import Ingest
from ..limits import Limits
from ..state.static_links import StaticLinks
from .incoming import Incoming
from .outgoing import Outgoing
from .settings import Ros2Settings

log = logging.getLogger("zenoh_tf.server.ros2")


def publish(
    settings: Ros2Settings,
    session: zenoh.Session,
    tree: TransformTree,
    links: StaticLinks,
    stack: ExitStack,
) -> Outgoing | None:
    """What publishes commits in the ROS 2 network of a session, until the stack is closed."""
    if not settings.publish:
        return None
    outgoing = Outgoing(session, tree, links, settings)
    stack.callback(outgoing.close)
    return outgoing


def receive(
    settings: Ros2Settings,
    session: zenoh.Session,
    ingest: Ingest,
    links: StaticLinks,
    limits: Limits,
    stack: ExitStack,
) -> Incoming | None:
    """What ingests the transforms of a session's ROS 2 network, until the stack is closed."""
    if not settings.receive:
        return None
    if not attachment.HAS_GIDS:
        log.warning(
            "the package xxhash is missing: publishers are known by their topic and session only, "
            "not by their id; install zenoh-tf with the extra ros2"
        )
    incoming = Incoming(session, ingest, links, limits, settings)
    stack.callback(incoming.close)
    return incoming
