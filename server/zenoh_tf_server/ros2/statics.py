"""Static transforms of ROS 2: kept per publisher, merged per child.

Some publishers send all of their links each time, older ones only what is new, and all send them
again to late subscribers. So what each publisher has sent is kept here, and only what differs goes
to the tree, and what the tree has refused or lost since, by a reset for instance. Of several
publishers of a child the one that sent last counts. A publisher whose token
has been gone for `--ros2-static-grace` is forgotten: its links pass to another publisher that has
sent them too, or leave the tree. A router's restart removes tokens for a moment only.

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
from zenoh_tf.errors import TransformException
from zenoh_tf.ros2.publishers import MAX_PUBLISHERS, Source
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
    gid: bytes | None  # of the publisher that sent it last
    number: int | None  # that publisher's number of the message
    waits: bool = True  # its put is not committed yet
    refused: bool = False

    def same(self, other: _Link) -> bool:
        return self.parent == other.parent and self.pose == other.pose

    def older(self, other: _Link) -> bool:
        """True if the other one's publisher sent it later. A session's publishers, and a node that
        is made again, count for themselves: their numbers are not comparable."""
        return (
            self.gid == other.gid
            and self.number is not None
            and other.number is not None
            and self.number < other.number
        )


@dataclass(slots=True, eq=False)
class _Publisher:
    authority: str = ""
    links: dict[str, _Link] = field(default_factory=dict)  # by child
    gone_s: float | None = None  # since when its token is gone


_Identity = tuple[str, str]  # see Source.identity


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
        self._publishers: dict[_Identity, _Publisher] = {}
        self._owners: dict[str, _Identity] = {}  # of each child: the publisher that sent it last
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
        self, source: Source, number: int | None, rows: TransformRows, *, live: bool
    ) -> Put | None:
        """Record a message, and return the put of what the tree needs of it; None if nothing.

        Args:
            source: Its publisher.
            number: The publisher's number of it: an older message that comes late changes nothing.
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
                link = _Link(names[parent], stamp_ns, tuple(pose), source.gid, number)
                if self._record(publisher, source.identity, names[child], link, live=live):
                    new[names[child]] = link
        if not new:
            return None
        put = self.put(source.authority, _rows(new))
        put.done = lambda accepted: self._done(new, accepted)
        return put

    @staticmethod
    def put(authority: str, rows: TransformRows) -> Put:
        """Static transforms as a put."""
        return Put.of_rows(authority, True, rows, time.time_ns())

    def _publisher(self, source: Source) -> _Publisher | None:
        """Requires the lock. None: there are too many."""
        publisher = self._publishers.get(source.identity)
        if publisher is None:
            if len(self._publishers) >= MAX_PUBLISHERS:
                return None
            publisher = self._publishers[source.identity] = _Publisher()
        publisher.authority = source.authority
        publisher.gone_s = None
        return publisher

    def _done(self, links: dict[str, _Link], accepted: bool) -> None:
        """Record that the put of some links was committed or refused."""
        with self._lock:
            for link in links.values():
                link.waits, link.refused = False, not accepted

    def _record(
        self, publisher: _Publisher, identity: _Identity, child: str, link: _Link, *, live: bool
    ) -> bool:
        """Record a link; True if the tree must get it. Requires the lock."""
        known = publisher.links.get(child)
        if known is not None:
            if link.older(known):
                return False
            if known.same(link) and not self._is_lost(known, child, identity, live=live):
                known.gid, known.number = link.gid, link.number
                return False
        elif self._links >= _MAX_LINKS:
            return True  # not kept, so it is put each time
        else:
            self._links += 1
        publisher.links[child] = link
        self._owners[child] = identity
        return True

    def _is_lost(self, known: _Link, child: str, identity: _Identity, *, live: bool) -> bool:
        """True if a link that is sent again must go to the tree again. Requires the lock."""
        if live and self._owners.get(child) != identity:
            return True  # another one has sent last, until now
        return known.refused or not (known.waits or self._tree_links.has_link(child))

    # --- publishers that come and go

    def came_or_went(self, identity: _Identity, is_there: bool) -> None:
        """Follow a publisher that has come, or is gone."""
        with self._lock:
            publisher = self._publishers.get(identity)
            if publisher is not None:
                publisher.gone_s = None if is_there else time.monotonic()

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

    def _forget(self, identity: _Identity) -> tuple[str, dict[str, dict[str, _Link]], set[str]]:
        """Forget a publisher. Returns its authority, what others have of what was its own, by their
        authorities, and the children that nobody has any more. Requires the lock."""
        publisher = self._publishers.pop(identity)
        self._links -= len(publisher.links)
        handed_over: dict[str, dict[str, _Link]] = {}
        orphans: set[str] = set()
        for child in publisher.links:
            if self._owners.get(child) != identity:
                continue
            for other, heir in self._publishers.items():
                if child in heir.links:
                    self._owners[child] = other
                    handed_over.setdefault(heir.authority, {})[child] = heir.links[child]
                    break
            else:
                del self._owners[child]
                orphans.add(child)
        return publisher.authority, handed_over, orphans

    def _remove(self, authority: str, children: set[str]) -> None:
        """Remove static links from the tree, unless another authority has set them since."""
        left = {child for child in children if self._tree_links.is_static_of(child, authority)}
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
