"""Static transforms of ROS 2: kept per publisher, merged per child.

Some publishers send all of their links each time, older ones only what is new, and all send them
again to late subscribers. So what each publisher has sent is kept here, and only what differs goes
to the tree, and what the tree has refused or lost since, by a reset or by another writer for
instance. A publisher whose token has been gone for `--ros2-static-grace` is forgotten: its links
pass to another publisher that has sent them too, or leave the tree. A router's restart removes
tokens for a moment only.

Of several publishers of a child the newest announcement counts. What comes live is newer than all
that is known. What publishers kept for late subscribers comes in any order, so their own times of
sending decide: a server that starts later has the same links as one that has heard everything.

Thread safety: all methods.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from zenoh_tf._core import TransformRows
from zenoh_tf.bounded_map import BoundedMap
from zenoh_tf.errors import TransformException
from zenoh_tf.ros2.publishers import MAX_PUBLISHERS, Identity, TopicSource
from zenoh_tf.ros2.topics import Received
from zenoh_tf.threads import Periodic

from ..ingest.put_queues import Put
from ..rate_limited_log import RateLimitedLog
from ..state.static_links import StaticLinks

#: How often publishers whose grace has ended are forgotten.
_PERIOD_S: Final = 0.25
_REMOVAL_S: Final = 5.0
#: Most links that are remembered by publisher. Others are stored each time that they come, and stay
#: when their publisher goes.
_MAX_LINKS: Final = 100_000


@dataclass(slots=True)
class _Link:
    parent: str
    stamp_ns: int
    pose: tuple[float, ...]
    number: int | None  # its publisher's number of the message
    sent_ns: int  # when it was sent, by the clock of its publisher
    waits: bool = True  # its put is not committed yet
    refused: bool = False

    def same(self, other: _Link) -> bool:
        return self.parent == other.parent and self.pose == other.pose

    def older(self, other: _Link) -> bool:
        """True if its publisher sent the other one later."""
        return self.number is not None and other.number is not None and self.number < other.number


@dataclass(slots=True, eq=False)
class _Publisher:
    authority: str = ""
    links: dict[str, _Link] = field(default_factory=dict)  # by child
    gone_s: float | None = None  # since when its token is gone
    went_alone: bool = False  # while others of its session stayed


class Statics:
    """What each publisher of `/tf_static` has sent."""

    def __init__(
        self, links: StaticLinks, grace_s: float, add: Callable[[list[Put]], None]
    ) -> None:
        """`add`: queues puts. `grace_s`: 0 keeps the links of publishers that are gone."""
        self._tree_links = links
        self._grace_s = grace_s
        self._add = add
        self._lock = threading.Lock()
        self._publishers: dict[Identity, _Publisher] = {}
        self._owners: dict[str, Identity] = {}  # of each child: the publisher that sent it last
        #: Publishers that went alone last, and when.
        self._went = BoundedMap[Identity, float](MAX_PUBLISHERS)
        self._links = 0  # over all publishers
        self._dropped = 0
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ros2"))
        self._thread = Periodic("ros2-statics", self._forget_gone, _PERIOD_S)
        if grace_s:
            self._thread.start()

    def close(self) -> None:
        """Forget no more publishers."""
        self._thread.close()

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {"ros2_static_links": self._links, "ros2_statics_dropped": self._dropped}

    def record(
        self, source: TopicSource, message: Received, rows: TransformRows, *, live: bool
    ) -> Put | None:
        """Record a message, and return the put of what the tree needs of it; None if nothing.

        Args:
            source: Its publisher.
            message: The message. One with a lower number that comes late changes nothing.
            rows: Its transforms.
            live: It is sent now. False: kept by its publisher, so it may be from before what
                other publishers have sent.
        """
        names = rows.names
        columns = (rows.parent, rows.child, rows.stamp, rows.pose)
        with self._lock:
            publisher = self._publisher(source)
            if publisher is None:
                return self.put(source.authority, rows)
            new: dict[str, _Link] = {}
            for parent, child, stamp_ns, pose in zip(*(c.tolist() for c in columns), strict=True):
                sent_ns = stamp_ns if message.sent_ns is None else message.sent_ns
                link = _Link(names[parent], stamp_ns, tuple(pose), message.number, sent_ns)
                if self._record(publisher, source.identity, names[child], link, live=live):
                    new[names[child]] = link
        if not new:
            return None
        return self._put(source.authority, source.identity, new)

    @staticmethod
    def put(authority: str, rows: TransformRows) -> Put:
        """Static transforms as a put."""
        return Put.of_rows(authority, True, rows, time.time_ns())

    def _publisher(self, source: TopicSource) -> _Publisher | None:
        """Requires the lock. None: there are too many."""
        publisher = self._publishers.get(source.identity)
        if publisher is None:
            if len(self._publishers) >= MAX_PUBLISHERS:
                return None
            publisher = self._publishers[source.identity] = _Publisher()
            publisher.gone_s = self._went.get(source.identity)
            publisher.went_alone = publisher.gone_s is not None
        publisher.authority = source.authority
        # A message that is recorded after its publisher's token has gone was under way.
        if not publisher.went_alone:
            publisher.gone_s = None
        return publisher

    def _done(self, identity: Identity, links: dict[str, _Link], accepted: bool) -> None:
        """Record that the put of some links was committed or refused."""
        overtaken: dict[Identity, dict[str, _Link]] = {}  # by this put, although they are newer
        with self._lock:
            for child, link in links.items():
                link.waits, link.refused = False, not accepted
                owner = self._owners.get(child, identity)
                newest = self._publishers[owner].links[child] if owner != identity else link
                if accepted and newest is not link and not (newest.waits or newest.refused):
                    newest.waits = True
                    overtaken.setdefault(owner, {})[child] = newest
            puts = [
                self._put(self._publishers[owner].authority, owner, found)
                for owner, found in overtaken.items()
            ]
        self._add(puts)

    def _put(self, authority: str, identity: Identity, links: dict[str, _Link]) -> Put:
        """The put of links that wait for it."""
        put = self.put(authority, _rows(links))
        put.done = lambda accepted: self._done(identity, links, accepted)
        return put

    def _record(
        self, publisher: _Publisher, identity: Identity, child: str, link: _Link, *, live: bool
    ) -> bool:
        """Record a link; True if the tree must get it. Requires the lock."""
        known = publisher.links.get(child)
        if known is not None:
            if link.older(known):
                return False
            if known.same(link) and not self._is_lost(known, child, publisher, identity, live=live):
                known.number, known.sent_ns = link.number, link.sent_ns
                return False
        elif self._links >= _MAX_LINKS:
            return True  # not kept, so it is put each time
        else:
            self._links += 1
        publisher.links[child] = link
        if not live and self._is_outdated(link, child, identity):
            link.waits = False
            return False
        self._owners[child] = identity
        return True

    def _is_outdated(self, link: _Link, child: str, identity: Identity) -> bool:
        """True if another publisher has announced a child later. Requires the lock."""
        owner = self._owners.get(child, identity)
        newest = self._publishers[owner].links.get(child)
        return owner != identity and newest is not None and newest.sent_ns > link.sent_ns

    def _is_lost(
        self, known: _Link, child: str, publisher: _Publisher, identity: Identity, *, live: bool
    ) -> bool:
        """True if a link that is sent again must go to the tree again. Requires the lock."""
        if live and self._owners.get(child) != identity:
            return True  # another one has sent last, until now
        if known.refused or known.waits:
            return known.refused
        if not live:
            return not self._tree_links.has_link(child)
        # Another one has written it since, on /tf for instance. A correction stays.
        return not (
            self._tree_links.is_static_of(child, publisher.authority)
            or self._tree_links.is_set_by_call(child)
        )

    # --- publishers that come and go

    def came_or_went(self, session: tuple[str, str], gid: bytes | None, is_there: bool) -> None:
        """Follow a publisher that has come or is gone: that of an id, or all of a session on one
        key (see `histories.CameOrWent`)."""
        with self._lock:
            if gid is not None:
                identity = (*session, gid)
                found = [self._publishers.get(identity)]
                if is_there:
                    self._went.pop(identity, None)
                else:
                    self._went[identity] = time.monotonic()
            else:
                # One that went alone does not come back with its session.
                found = [
                    each
                    for identity, each in self._publishers.items()
                    if identity[:2] == session and not each.went_alone
                ]
            for publisher in found:
                if publisher is not None:
                    publisher.gone_s = None if is_there else time.monotonic()
                    publisher.went_alone = gid is not None and not is_there

    def _forget_gone(self) -> None:
        before_s = time.monotonic() - self._grace_s
        with self._lock:
            gone = [
                identity
                for identity, each in self._publishers.items()
                if each.gone_s is not None and each.gone_s <= before_s
            ]
            forgotten = [self._forget(identity) for identity in gone]
        for authority, handed_over, orphans in forgotten:
            self._add([self.put(heir, _rows(links)) for heir, links in handed_over.items()])
            self._remove(authority, orphans)

    def _forget(self, identity: Identity) -> tuple[str, dict[str, dict[str, _Link]], set[str]]:
        """Forget a publisher. Returns its authority, what others have of what was its own, by their
        authorities, and the children that nobody has any more. Requires the lock."""
        publisher = self._publishers.pop(identity)
        self._links -= len(publisher.links)
        handed_over: dict[str, dict[str, _Link]] = {}
        orphans: set[str] = set()
        for child in publisher.links:
            if self._owners.get(child) != identity:
                continue
            heirs = [other for other, each in self._publishers.items() if child in each.links]
            if not heirs:
                del self._owners[child]
                orphans.add(child)
                continue
            newest = max(heirs, key=lambda other: self._publishers[other].links[child].sent_ns)
            self._owners[child], heir = newest, self._publishers[newest]
            handed_over.setdefault(heir.authority, {})[child] = heir.links[child]
        return publisher.authority, handed_over, orphans

    def _remove(self, authority: str, children: set[str]) -> None:
        """Remove static links from the tree, unless another authority has set them since."""
        left = {
            child
            for child in children
            if child not in self._owners and self._tree_links.is_static_of(child, authority)
        }
        while left:
            removed = {child for child in left if self._removed(child)}
            if not removed:
                break  # frames that others hang on to
            left -= removed
            self._dropped += len(removed)
        self._log.info(
            f"static transforms of {authority}",
            f"its publisher is gone: {len(children) - len(left)} removed, {len(left)} left",
        )

    def _removed(self, child: str) -> bool:
        expires_ns = time.monotonic_ns() + round(_REMOVAL_S * 1e9)
        try:
            self._tree_links.remove_frame(child, False, expires_ns)
        except TransformException:
            return False
        return True


def _rows(links: dict[str, _Link]) -> TransformRows:
    return TransformRows.of_tuples(
        (link.parent, child, link.stamp_ns, link.pose) for child, link in links.items()
    )
