"""The viewer's thread: reads the source, computes, draws."""

from __future__ import annotations

import contextlib
import io
import socket
import time
from collections import deque
from dataclasses import dataclass
from typing import Final

import viser

from zenoh_tf.text import quoted
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.viewer.panel import Panel, figures_html, look_from, status_html
from zenoh_tf_tools.viewer.placement import Placement, place, roots_by_size
from zenoh_tf_tools.viewer.scene import Scene
from zenoh_tf_tools.viewer.source import Link, ViewedTree
from zenoh_tf_tools.viewer.trails import trail_segments

_PERIOD_S: Final = 0.05
#: Without a browser: only often enough that a new browser finds the frames.
_IDLE_PERIOD_S: Final = 0.5
#: What is costly and need not be smooth: the list of frames, figures, trails.
_SLOW_PERIOD_S: Final = 0.25
#: At least this many times the time that a picture took is slept after it, so that the thread
#: needs at most a quarter of a processor, however many frames there are.
_REST: Final = 3.0


@dataclass(frozen=True)
class Options:
    """What the command line says.

    Attributes:
        stale_s: From this age on, in seconds, a link is marked as stale.
        max_frames: Most frames that are drawn.
        at_ns: The time of a recording to begin at, in nanoseconds.
        fixed: The fixed frame; None for the root of the tree with the most frames.
        axes_m: Length of the axes in metres.
        trail_s: Length of the trails in seconds.
    """

    stale_s: float
    max_frames: int
    at_ns: int
    fixed: str | None
    axes_m: float
    trail_s: float


def open_server(host: str, port: int) -> viser.ViserServer:
    """Start viser's server.

    Raises:
        CommandError: It cannot listen on this address.
    """
    # viser uses the next port if one is in use, and waits for ever if none can be had.
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except OSError as error:
        raise CommandError(f"cannot listen on {quoted(host)}: {error}") from error
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a table
        server = viser.ViserServer(host, port, label="zenoh-tf", verbose=False)
    # The scene can be shared through a server on the internet. Neither the button, nor a message
    # of a page that a browser has opened may begin that.
    server.gui.configure_theme(show_share_button=False, show_logo=False, control_width="medium")
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    return server


def close_server(server: viser.ViserServer) -> None:
    """Stop viser's server, which prints that it did."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


class Viewer:
    """Draws a source until it is closed. One thread calls its methods."""

    def __init__(self, source: ViewedTree, server: viser.ViserServer, options: Options) -> None:
        self._source = source
        self._server = server
        self._options = options
        self._clicked: deque[str] = deque(maxlen=1)
        self._going = deque[bool](maxlen=1)
        self._links: dict[str, Link] = {}
        self._hidden = 0
        self._time_ns = 0
        self._slow_at_s = 0.0
        self._last_s = time.monotonic()
        self._fixed = ""
        self._trail: tuple[object, ...] = ()
        self._looked = False
        self.scene = Scene(server, self._clicked.append)
        self.panel = Panel(
            server,
            range_ns=source.range_ns,
            at_ns=options.at_ns,
            axes_m=options.axes_m,
            trail_s=options.trail_s,
        )
        self.panel.go_to.on_click(lambda _: self._going.append(True))

    def run(self) -> None:
        """Draw for ever."""
        while True:
            start_s = time.monotonic()
            self.step()
            spent_s = time.monotonic() - start_s
            period_s = _PERIOD_S if self._server.get_clients() else _IDLE_PERIOD_S
            time.sleep(max(period_s - spent_s, spent_s * _REST))

    def step(self) -> None:
        """Draw what is the case now."""
        now_s = time.monotonic()
        slow = now_s >= self._slow_at_s
        with self._server.atomic():
            if slow:
                self._slow_at_s = now_s + _SLOW_PERIOD_S
                self._list_frames()
            before_ns = self._time_ns
            if self._source.range_ns is None:
                self._time_ns = self._source.now_ns([*self._links.values()])
            else:
                self._time_ns = self.panel.time_ns(now_s - self._last_s)
            self._last_s = now_s
            self._read_links()
            if slow:
                self._offer()
            if self._clicked:
                self.panel.select(self._clicked.popleft())
            placement = self._draw()
            if slow or (self._time_ns != before_ns and self._source.range_ns is not None):
                self._draw_trails()
            if slow:
                self._report(placement)
        self._go(placement)

    def _list_frames(self) -> None:
        """Choose the frames to draw: those that were drawn stay, and ancestors come along."""
        names = self._source.names()
        if len(names) <= self._options.max_frames:
            chosen = dict.fromkeys(names)
        else:
            there = set(names)
            chosen = dict.fromkeys(name for name in self._links if name in there)
            for name in names:
                if len(chosen) >= self._options.max_frames:
                    break
                chosen[name] = None
        self._hidden = len(names) - len(chosen)
        self._links = {
            name: self._links.get(name, Link(name, None, False, None, None, None, ""))
            for name in chosen
        }

    def _read_links(self) -> None:
        links: dict[str, Link] = {}
        for name in self._links:
            link = self._source.link(name, self._time_ns)
            if link is not None:
                links[name] = link
        self._links = links

    def _offer(self) -> None:
        fixed = self._options.fixed
        if fixed not in self._links:
            fixed = next(iter(roots_by_size(self._links)), None)
        self.panel.offer([*self._links], fixed)

    def _draw(self) -> Placement:
        self._fixed = self.panel.fixed or ""
        placement = place(self._source.lookups, self._links, self._fixed)
        self.scene.draw(
            placement,
            self._links,
            self._options.stale_s,
            axes_m=self.panel.axes_m,
            names=self.panel.names,
            selected=self.panel.selected,
        )
        if placement.names and not self._looked:
            self._looked = True
            camera = self._server.initial_camera
            camera.position, camera.look_at = look_from([p[:3] for p in placement.poses])
        return placement

    def _draw_trails(self) -> None:
        length_s = self.panel.trail_s
        drawn = (self._fixed, self._time_ns, length_s, len(self._links))
        if drawn == self._trail:
            return
        self._trail = drawn
        moving = self._links.values() if self._fixed and length_s else ()
        self.scene.draw_trails(
            trail_segments(self._source.lookups, self._fixed, moving, self._time_ns, length_s)
        )

    def _report(self, placement: Placement) -> None:
        link = self._links.get(self.panel.selected or "")
        self.panel.show(self.panel.figures, figures_html(link, placement, self._fixed))
        self.panel.show(
            self.panel.status,
            status_html(
                self._links,
                placement,
                self._fixed,
                self._options.stale_s,
                self._time_ns,
                self._hidden,
                self._source.trouble(),
            ),
        )

    def _go(self, placement: Placement) -> None:
        """Move the cameras to the frame that was chosen, if the button was pressed."""
        if not self._going:
            return
        self._going.clear()
        row = placement.rows.get(self.panel.selected or "")
        if row is None:
            return
        at = placement.poses[row, :3]
        for client in self._server.get_clients().values():
            position, _ = look_from([at])
            client.camera.position, client.camera.look_at = position, at
