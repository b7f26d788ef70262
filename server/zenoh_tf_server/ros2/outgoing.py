"""ROS 2 out: publishes on `/tf` and `/tf_static` what others than ROS 2 have committed.

Of each frame the newest transform goes out, at a limited rate. Of static links all go out together
whenever one changes, and late subscribers get them again: tf2 merges what it gets, and a bridge
keeps only the last message. Humble knows another key than later releases, and bridges a third one,
so each message is put on all three; without a subscriber that costs nothing.

No loops: what came from ROS 2 has such an authority, and is not published, nor is what a robot's
server has got over ROS 2 from a server like this one.

Thread safety: all methods.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any, Final

import zenoh
from zenoh import ext

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import TransformException
from zenoh_tf.ros2 import attachment, keys
from zenoh_tf.ros2.attachment import Attachment
from zenoh_tf.ros2.cdr import encode_tf_message
from zenoh_tf.ros2.keys import TF_MESSAGE, Topic
from zenoh_tf.ros2.publishers import AUTHORITIES, NODE, is_echo
from zenoh_tf.threads import Periodic

from ..rate_limited_log import RateLimitedLog
from ..state.static_links import StaticLinks
from .settings import Ros2Settings

_VOLATILE: Final = 2
_TRANSIENT_LOCAL: Final = 1
#: The quality of service of each topic: durability and depth, as of tf2's broadcasters.
_QOS: Final = {"tf": (_VOLATILE, 100), "tf_static": (_TRANSIENT_LOCAL, 1)}
#: Transforms that wait for their turn; the oldest commits make room.
_MAX_WAITING: Final = 200_000
#: Transforms in one message.
_MAX_ROWS: Final = 1000
#: How often changes of static links are published.
_STATICS_S: Final = 0.1
_KNOWN_NAMES: Final = 65_536

_Row = tuple[str, int, Any]  # parent, stamp in ns, pose


class _Peer:
    """One publisher of a topic: on one key, for one kind of receivers. All say which session sends,
    so that another server knows them for copies of one message."""

    def __init__(self, session: zenoh.Session, key: str, token: str | None, latched: bool) -> None:
        self._gid = (attachment.gid_of(token) if token else None) or uuid.uuid4().bytes
        self._number = 0
        self._sends_attachment = token is not None
        self._is_latched = latched
        self.publisher: Any
        if latched:
            self.publisher = ext.declare_advanced_publisher(
                session,
                key,
                congestion_control=zenoh.CongestionControl.BLOCK,
                allowed_destination=zenoh.Locality.REMOTE,
                cache=ext.CacheConfig(1),
                publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=0.5
                ),
            )
        else:
            self.publisher = session.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
            )

    @property
    def has_listeners(self) -> bool:
        return bool(self.publisher.matching_status.matching)

    def put(self, payload: bytes) -> None:
        self._number += 1  # rmw_zenoh begins with 1
        mark = Attachment(self._number, time.time_ns(), self._gid)
        about: dict[str, Any] = {}
        if self._sends_attachment:
            about["attachment"] = attachment.encode(mark)
        if not self._is_latched:  # an advanced publisher says it by itself
            number = self._number % (1 << 32)
            about["source_info"] = zenoh.SourceInfo(self.publisher.id, number)
        self.publisher.put(payload, **about)


class Outgoing:
    """Publishes until it is closed."""

    def __init__(
        self,
        session: zenoh.Session,
        tree: TransformTree,
        links: StaticLinks,
        settings: Ros2Settings,
    ) -> None:
        self._tree = tree
        self._links = links
        self._domain = settings.domain
        self._is_chosen = functools.lru_cache(_KNOWN_NAMES)(
            lambda name: any(fnmatchcase(name, pattern) for pattern in settings.publish)
        )
        self._lock = threading.Lock()
        self._commits: deque[tuple[wire.Commit, bytes]] = deque()
        self._waiting = 0  # transforms in them
        self._tokens: list[zenoh.LivelinessToken] = []
        self._peers: dict[str, list[_Peer]] = {}
        self._statics = encode_tf_message(TransformRows.of_tuples([]))  # as sent last
        self._static_rows: dict[str, _Row] = {}  # in it, and what ROS 2 cannot express
        self._statics_change = -1
        self._messages = self._transforms = self._left_out = 0
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ros2"))
        self._declare(session)
        self._period_s = 1 / settings.rate_hz
        self._next_s = 0.0
        period_s = min(self._period_s, _STATICS_S)
        self._thread = Periodic("ros2-out", self._publish_due, period_s)
        self._thread.start()

    def _declare(self, session: zenoh.Session) -> None:
        zid = str(session.info.zid())
        self._declare_token(session, keys.node_token(self._domain, zid, NODE))
        number = 0
        for name, (durability, depth) in _QOS.items():
            qos = keys.quality_of_service(durability, depth)
            topic, latched = Topic(name, "", self._domain), durability == _TRANSIENT_LOCAL
            peers = self._peers[name] = []
            for hash_ in (TF_MESSAGE.hash, keys.NO_HASH):
                number += 1
                token = keys.publisher_token(topic, zid, number, NODE, TF_MESSAGE, hash_, qos)
                key = keys.rmw_key(topic, TF_MESSAGE, hash_)
                peers.append(_Peer(session, key, token, latched))
                self._declare_token(session, token)
            peers.append(_Peer(session, name, None, latched))

    def close(self) -> None:
        """Publish no more."""
        self._thread.close()
        for token in self._tokens:
            token.undeclare()
        for peers in self._peers.values():
            for peer in peers:
                peer.publisher.undeclare()

    def committed(self, commit: wire.Commit, stored: bytes) -> None:
        """Queue a commit that the tree has applied."""
        if commit.static or commit.authority.startswith(AUTHORITIES) or is_echo(commit.authority):
            return
        with self._lock:
            self._commits.append((commit, stored))
            self._waiting += len(commit.rows)
            while self._waiting > _MAX_WAITING:
                self._waiting -= len(self._commits.popleft()[0].rows)

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {
            "ros2_published_messages": self._messages,
            "ros2_published_transforms": self._transforms,
            "ros2_unpublishable": self._left_out,
        }

    def _declare_token(self, session: zenoh.Session, key: str) -> None:
        self._tokens.append(session.liveliness().declare_token(key))

    def _publish_due(self) -> None:
        self._attempt(self._publish_statics)  # first: links before what hangs on them
        if (now_s := time.monotonic()) >= self._next_s:
            self._next_s = now_s + self._period_s
            self._attempt(self._publish_moving)

    def _attempt(self, publish: Callable[[], None]) -> None:
        try:
            publish()
        except Exception as error:  # publishing must continue
            self._log.warn("publishing on ROS 2", f"{type(error).__name__}: {error}")

    # --- moving frames

    def _publish_moving(self) -> None:
        with self._lock:
            commits, self._commits, self._waiting = self._commits, deque(), 0
        newest: dict[str, _Row] = {}
        for commit, stored in commits:
            names = commit.rows.names
            columns = (commit.rows.parent, commit.rows.child, commit.rows.stamp)
            rows = (*(column.tolist() for column in columns), stored, commit.rows.pose)
            for parent, child, stamp_ns, kept, pose in zip(*rows, strict=True):
                name = names[child]
                if kept != 1 or not self._is_chosen(name):
                    continue
                known = newest.get(name)
                if known is None or known[1] <= stamp_ns:
                    newest[name] = (names[parent], stamp_ns, pose)
        if not newest or not any(peer.has_listeners for peer in self._peers["tf"]):
            return
        items = list(newest.items())
        for begin in range(0, len(items), _MAX_ROWS):
            found = _Encoded(dict(items[begin : begin + _MAX_ROWS]))
            self._count_left_out("tf", found)
            if found.count:
                self._put("tf", found)

    # --- static links

    def _publish_statics(self) -> None:
        change = self._links.changes
        if change == self._statics_change:
            return
        rows = self._all_statics()
        found = _Encoded(rows)
        self._count_left_out("tf_static", found)
        if found.payload != self._statics:
            self._put("tf_static", found)
            self._statics = found.payload
        self._static_rows = rows
        self._statics_change = change  # last: what has failed is tried again

    def _all_statics(self) -> dict[str, _Row]:
        found: dict[str, _Row] = {}
        for record in self._links.records():
            name, parent = record["name"], record["parent"]
            if record["authority"].startswith(AUTHORITIES) or not self._is_chosen(name):
                continue
            if is_echo(record["authority"]):
                if name in self._static_rows:  # what is published stays: it is heard by late nodes
                    found[name] = self._static_rows[name]
                continue
            try:
                link = self._tree.lookup_transform(parent, name)
            except TransformException:
                continue  # removed since
            found[name] = (parent, record["newest_stamp_ns"] or 0, link.transform.pose())
        return found

    # --- both

    def _count_left_out(self, topic: str, found: _Encoded) -> None:
        if found.refusal is not None:
            self._left_out += found.left_out
            self._log.warn(
                f"publishing on /{topic}", f"{found.left_out} left out, the last: {found.refusal}"
            )

    def _put(self, topic: str, found: _Encoded) -> None:
        self._messages += 1  # before it is heard, and may come back
        self._transforms += found.count
        latched = topic == "tf_static"  # late subscribers get it too
        for peer in self._peers[topic]:
            if latched or peer.has_listeners:
                peer.put(found.payload)


class _Encoded:
    """A message of the rows that ROS 2 can express: it has fewer stamps and names than the tree,
    and one such row must not keep the others back."""

    def __init__(self, rows: dict[str, _Row]) -> None:
        self.refusal: TransformException | None = None
        self.left_out = 0
        try:
            self.payload = _encode(rows)
        except TransformException:
            rows = {child: row for child, row in rows.items() if self._is_good(child, row)}
            self.payload = _encode(rows)
        self.count = len(rows)

    def _is_good(self, child: str, row: _Row) -> bool:
        try:
            _encode({child: row})
        except TransformException as error:
            self.refusal = error
            self.left_out += 1
            return False
        return True


def _encode(rows: dict[str, _Row]) -> bytes:
    """The message with these rows, by child."""
    return encode_tf_message(
        TransformRows.of_tuples(
            (parent, child, stamp_ns, pose) for child, (parent, stamp_ns, pose) in rows.items()
        )
    )
