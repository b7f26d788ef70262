"""Sends a mirror's links to the Foxglove app, over the WebSocket of foxglove-sdk.

At each tick the newest sample of every link that has changed goes out as one message of Foxglove's
schema ``FrameTransforms``. A new subscriber gets all links at once, static and stopped ones too. So
does everybody every few seconds, because the SDK drops the oldest messages of a slow subscriber.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Final

from foxglove import Context, channels, start_server
from foxglove.messages import FrameTransform, FrameTransforms, Quaternion, Timestamp, Vector3
from foxglove.websocket import ChannelView, Client, ServerListener, StatusLevel, WebSocketServer

from zenoh_tf.text import quoted
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.viewer.changes import Change, LinkChanges
from zenoh_tf_tools.viewer.source import ViewedLink, ViewedTree

TOPIC: Final = "/tf"
#: How often everybody gets all links, in seconds.
_REPEAT_S: Final = 5.0
#: How often the list of frames is read, in seconds.
_LIST_S: Final = 0.25
#: Most links of one message.
_MOST_LINKS: Final = 500
#: After each tick the thread rests this many times as long as it worked.
_REST: Final = 3.0
#: Foxglove's seconds are 32 bits without a sign.
_STAMPS_NS: Final = range(0, 2**32 * 10**9)


class FoxgloveBridge(ServerListener):
    """A WebSocket server for the Foxglove app. One thread calls its methods."""

    def __init__(self, source: ViewedTree, name: str, host: str, port: int) -> None:
        """Start to listen.

        Args:
            source: The tree to show.
            name: What the app calls it.
            host: Address to listen on.
            port: Port to listen on; 0: a free one.

        Raises:
            CommandError: It cannot listen there.
        """
        self._source = source
        self._new = threading.Event()  # somebody has subscribed
        self._names: list[str] = []
        self._listed_s = self._sent_all_s = -_REPEAT_S
        self._changes = LinkChanges(source)
        self._time_ns = 0
        self._trouble: str | None = None
        self._context = context = Context()  # nobody else holds it
        self._channel = channels.FrameTransformsChannel(TOPIC, context=context)
        try:
            self._server: WebSocketServer = start_server(
                name=name, host=host, port=port, server_listener=self, context=context
            )
        except RuntimeError as error:
            raise CommandError(f"cannot listen on {quoted(host)} port {port}: {error}") from error

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self._server.port

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """A thread of the SDK says so."""
        self._new.set()

    def run(self, rate_hz: float) -> None:
        """Send for ever, so many times a second at most."""
        while True:
            start_s = time.monotonic()
            if self._channel.has_sinks():
                self.step()
            spent_s = time.monotonic() - start_s
            time.sleep(max(1 / rate_hz - spent_s, spent_s * _REST))

    def step(self) -> None:
        """Send what has changed since the last step."""
        now_s = time.monotonic()
        if now_s - self._listed_s >= _LIST_S:
            self._listed_s = now_s
            self._names = self._source.names()
        if self._new.is_set() or now_s - self._sent_all_s >= _REPEAT_S:
            self._new.clear()
            self._sent_all_s = now_s
            self._changes.forget()
        links = [link for name in self._names if (link := self._source.link(name, self._time_ns))]
        self._time_ns = self._source.now_ns(links)
        changed = list(self._changes.take(x for x in links if _stamp(x) in _STAMPS_NS))
        for first in range(0, len(changed), _MOST_LINKS):
            self._send(changed[first : first + _MOST_LINKS])
        self._report(links)

    def close(self) -> None:
        """End all connections."""
        self._server.stop()

    def _send(self, changes: Sequence[Change]) -> None:
        transforms = [
            FrameTransform(
                timestamp=Timestamp(*divmod(_stamp(link), 10**9)),
                parent_frame_id=str(link.parent),
                child_frame_id=link.name,
                translation=Vector3(x=pose[0], y=pose[1], z=pose[2]),
                rotation=Quaternion(x=pose[3], y=pose[4], z=pose[5], w=pose[6]),
            )
            for link, pose in ((link, pose.tolist()) for link, pose in changes)
        ]
        log_ns = min(max(self._time_ns, 0), _STAMPS_NS[-1])
        self._channel.log(FrameTransforms(transforms=transforms), log_time=log_ns)

    def _report(self, links: Sequence[ViewedLink]) -> None:
        """Show trouble in the app's list of problems."""
        trouble = self._source.trouble()
        if trouble is None:
            far = [x.name for x in links if x.parent and _stamp(x) not in _STAMPS_NS]
            if far:
                trouble = f"{len(far):,} links not shown: stamps outside of 1970 to 2106, "
                trouble += f"first {quoted(far[0])}"
        if trouble is None and self._trouble is not None:
            self._server.remove_status(["trouble"])
        elif trouble is not None and trouble != self._trouble:
            self._server.publish_status(trouble, StatusLevel.Warning, "trouble")
        self._trouble = trouble


def _stamp(link: ViewedLink) -> int:
    return link.sample_ns or 0
