"""The viewer's thread: reads the source, computes, draws."""

from __future__ import annotations

import contextlib
import io
import socket
import time
from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray
from viser._messages import RunJavascriptMessage

from zenoh_tf import Estimate, TransformException, Velocity
from zenoh_tf.text import quoted
from zenoh_tf_tools.errors import CommandError
from zenoh_tf_tools.viewer import origins
from zenoh_tf_tools.viewer.camera import axes_m, typical_link_m
from zenoh_tf_tools.viewer.cameras import Cameras
from zenoh_tf_tools.viewer.controls.figures import figures_html, findings_html, status_html
from zenoh_tf_tools.viewer.controls.frame_tree import with_descendants
from zenoh_tf_tools.viewer.controls.panel import SHOW_ALL, Panel
from zenoh_tf_tools.viewer.controls.timeline import timeline_html
from zenoh_tf_tools.viewer.findings import Findings, Observe
from zenoh_tf_tools.viewer.ghost import Ghost
from zenoh_tf_tools.viewer.live import is_clock
from zenoh_tf_tools.viewer.models import Model, Models
from zenoh_tf_tools.viewer.placement import NOTHING, place, roots_by_size
from zenoh_tf_tools.viewer.scene import SELECTED_AXES, Look, Scene
from zenoh_tf_tools.viewer.source import ViewedLink, ViewedTree
from zenoh_tf_tools.viewer.trails import trails_of

#: Run once in each page. The panel is folded where it lies over the scene, in a narrow window; and
#: the scene does not fade in: a slow browser takes ten seconds for it.
_PAGE: Final = """
if (!window.zenohTf) {
  window.zenohTf = true;
  document.querySelector('[style*="cursor: pointer"][style*="height: 3.5em"]')?.click();
  const style = document.createElement("style");
  style.textContent = "canvas { opacity: 1 !important }";
  document.head.append(style);
}
"""
_PERIOD_S: Final = 0.05
#: Without a browser: only often enough that a new browser finds the frames.
_IDLE_PERIOD_S: Final = 0.5
#: What is costly and need not be smooth: the list of frames, figures, trails.
_SLOW_PERIOD_S: Final = 0.25
#: So long after the first frames came, the cameras are fitted to those that come after them.
_FIT_S: Final = 5.0
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
        axes_m: Length of the axes in metres; None for one that fits the tree.
        trail_s: Length of the trails in seconds.
    """

    stale_s: float
    max_frames: int
    at_ns: int
    fixed: str | None
    axes_m: float | None
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
    with contextlib.redirect_stdout(io.StringIO()), origins.checked():  # it prints a table
        server = viser.ViserServer(host, port, label="zenoh-tf", verbose=False)
    # The scene can be shared through a server on the internet. Neither the button, nor a message
    # of a page that a browser has opened may begin that.
    # Shadows made pictures three times as slow in a browser that draws in software.
    server.scene.configure_default_lights(cast_shadow=False)
    # viser has no options for what this does.
    server.gui._websock_interface.queue_message(RunJavascriptMessage(_PAGE))
    server.gui.configure_theme(show_share_button=False, show_logo=False, control_width="medium")
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    return server


def close_server(server: viser.ViserServer) -> None:
    """Stop viser's server, which prints that it did."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


class Viewer:
    """Draws a source until it is closed. One thread calls its methods."""

    def __init__(
        self,
        source: ViewedTree,
        server: viser.ViserServer,
        options: Options,
        observe: Observe,
        models: Sequence[Model] = (),
    ) -> None:
        """Draw nothing yet.

        Args:
            source: What to draw.
            server: Where to.
            options: How.
            observe: Gathers the facts for the doctor; called in another thread.
            models: The shapes of robots.
        """
        self._source = source
        self._server = server
        self._options = options
        self._clicked: deque[str] = deque(maxlen=1)
        self._links: dict[str, ViewedLink] = {}
        self._left_out = 0
        self._is_read = False  # the links, since they were placed
        self._time_ns: int | None = None
        self._slow_at_s = 0.0
        self._last_s = time.monotonic()
        self._fixed = ""
        self._fitted = ("", 0)  # the fixed frame and count of frames that cameras were fitted for
        self._fit_until_s = 0.0
        self._followed: str | None = None
        self._placement = NOTHING
        self._link_m = 0.0
        self._trail: tuple[object, ...] = ()
        self.cameras = Cameras(server)
        self.scene = Scene(server, self._clicked.append)
        self.ghost = Ghost(server.scene)
        self._estimate: Estimate | TransformException | None = None
        self.models = Models(server.scene, models)
        self.findings = Findings(observe, wanted=lambda: bool(server.get_clients()))
        self.panel = Panel(
            server,
            range_ns=source.range_ns,
            at_ns=options.at_ns,
            trail_s=options.trail_s,
            has_robot=bool(models),
        )

    def close(self) -> None:
        """End the thread of the doctor."""
        self.findings.close()

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
        if slow:
            self._slow_at_s = now_s + _SLOW_PERIOD_S
        with self._server.atomic():
            before_ns = self._time_ns
            self._choose_time(now_s - self._last_s)
            self._last_s = now_s
            moved = self._time_ns != before_ns
            if moved or self._is_live or (slow and self._source.range_ns is not None):
                self._read(slow)
            if slow:
                self._offer()
            if self._clicked:
                self.panel.select(self._clicked.popleft())
            self._draw(slow or (moved and not self._is_live))
            if slow:
                self._report()
        self._move_cameras()

    @property
    def _is_live(self) -> bool:
        """Whether the newest samples are shown, not a time that was chosen."""
        return self._source.range_ns is None and self.panel.clock.running

    def _choose_time(self, elapsed_s: float) -> None:
        clock = self.panel.clock
        time_ns = clock.next_ns(elapsed_s, self._source.now_ns([*self._links.values()]))
        for step in clock.steps():
            selected = self._links.get(self.panel.selected or "")
            moves = selected is not None and selected.age_s is not None
            names = [selected.name] if selected is not None and moves else [*self._links]
            time_ns = clock.step_to(self._source.step_ns(names, time_ns, step))
        self._time_ns = time_ns

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
        self._left_out = len(names) - len(chosen)
        self._links = {
            name: self._links.get(name, ViewedLink(name, None, False, None, None, None, ""))
            for name in chosen
        }

    def _read(self, frames_too: bool) -> None:
        """Read the links. A paused picture stays as it is, while the server forgets its time."""
        if frames_too:
            self._list_frames()
        links: dict[str, ViewedLink] = {}
        past = not self._is_live
        for name in self._links:
            link = self._source.link(name, self._time_ns or 0, past=past)
            if link is not None:
                links[name] = link
        self._links = links
        self._is_read = True

    def _offer(self) -> None:
        fixed = self._options.fixed
        if fixed not in self._links:
            fixed = next(iter(roots_by_size(self._links)), None)
        self.panel.offer([*self._links], fixed)
        self.panel.frames.update(self._links)

    def _draw(self, trails_too: bool) -> None:
        fixed = self.panel.fixed or ""
        if self._is_read or fixed not in self._placement.rows:
            self._placement = place(self._source.lookups, self._links, fixed)
        elif fixed != self._fixed:
            self._placement = self._placement.seen_from(fixed)
        self._fixed, self._is_read = fixed, False
        placement = self._placement
        hidden = frozenset(self.panel.frames.unchecked)
        if trails_too:
            self._find_trails()
        self._follow()
        self._fit_first()
        camera = self.cameras.latest()
        length_m = self._options.axes_m or axes_m(self._link_m, camera)
        look = Look(
            stale_s=self._options.stale_s,
            axes_m=length_m * self.panel.axes.value,
            names=self.panel.names.value,
            selected=self.panel.selected,
            hidden=hidden,
            faults=self.findings.of_frames(),
        )
        self.scene.draw(placement, self._links, look, camera)
        self.models.draw(placement, self.scene.origin, hidden, self.panel.robot.value)
        self._draw_ghost(look)

    def _draw_ghost(self, look: Look) -> None:
        """Draw the picked frame of a server as it is now."""
        name, self._estimate = look.selected or "", None
        if self._is_live and self.panel.estimate.value and name in self._placement.rows:
            # By the server's clock rather than this machine's, unless the stamps are of another.
            stamp_ns = None if is_clock(self._time_ns or 0) else self._time_ns
            try:
                self._estimate = self._source.lookups.estimate_transform(
                    self._fixed, name, stamp_ns
                )
            except TransformException as error:
                self._estimate = error
        found = None
        if isinstance(self._estimate, Estimate) and name not in look.hidden:
            found = self._estimate
        self.ghost.draw(found, self.scene.origin, SELECTED_AXES * look.axes_m)

    def _follow(self) -> None:
        """Move the scene's origin as the frame that is followed does: its camera stays."""
        if not self.panel.follow.value:
            self._followed = None
            return
        row = self._placement.rows.get(self._followed or self.panel.selected or "")
        if row is None:
            if self._followed is None:
                self.panel.follow.value = False  # there is nothing to follow
            return
        position = self._placement.poses[row, :3]
        if self._followed is None:
            self._followed = self.panel.selected
            self._followed_from = position - self.scene.origin
        self.scene.origin = position - self._followed_from

    def _fit_first(self) -> None:
        """Fit the cameras to the first picture in each fixed frame, and to frames soon after it."""
        fitted = (self._fixed, len(self._placement.names))
        if not self._placement.names or self._fitted == fitted:
            return
        if self._fitted[0] != self._fixed:
            self._fit_until_s = time.monotonic() + _FIT_S
            self._followed = None
            # So that the numbers that the browser computes with are small.
            self.scene.origin = np.round(np.median(self._placement.poses[:, :3], axis=0), -3)
        if time.monotonic() < self._fit_until_s:
            self._fitted = fitted
            self._show_all()

    def _show_all(self) -> None:
        hidden = self.panel.frames.unchecked
        points = self._points(self._placement.rows.keys() - hidden)
        if len(points):
            self._link_m = typical_link_m(self._placement, self._links)
            self.scene.measure(self.cameras.show(points))

    def _find_trails(self) -> None:
        length_s = self.panel.trail.value
        hidden = self.panel.frames.unchecked
        drawn = (self._fixed, self._time_ns, length_s, len(self._links), len(hidden))
        if drawn == self._trail:
            return
        self._trail = drawn
        time_ns = self._time_ns or 0
        moving = [x for x in self._links.values() if x.name not in hidden]
        self.scene.set_trails(
            trails_of(
                self._source.lookups,
                self._fixed,
                moving if self._fixed and length_s else (),
                time_ns,
                length_s,
            )
        )

    def _report(self) -> None:
        link = self._links.get(self.panel.selected or "")
        self.panel.show(
            self.panel.figures,
            figures_html(
                link,
                self._placement,
                self._fixed,
                self._velocity(link),
                self._estimate,
                [] if link is None else self.findings.of(link.name),
            ),
        )
        self.panel.show(self.panel.faults, findings_html(self.findings.found))
        if self._source.range_ns is not None:
            spans = {x: self._source.spans_ns(x) for x in self.findings.of_frames()}
            self.panel.show(
                self.panel.timeline,
                timeline_html(
                    self._source.range_ns,
                    self._time_ns or 0,
                    {name: found for name, found in spans.items() if found},
                ),
            )
        self.panel.show(
            self.panel.status,
            status_html(
                self._links,
                self._placement,
                self._fixed,
                self._options.stale_s,
                self._time_ns or 0,
                time.time_ns(),
                self._left_out,
                self._source.trouble(),
                self._followed,
            ),
        )

    def _velocity(self, link: ViewedLink | None) -> Velocity | None:
        """How the picked frame moves in the fixed frame; None if it has not enough samples."""
        if link is None or link.name not in self._placement.rows or link.name == self._fixed:
            return None
        time_ns = None if self._is_live else self._time_ns
        try:
            return self._source.lookups.lookup_velocity(link.name, self._fixed, time_ns)
        except TransformException:
            return None

    def _move_cameras(self) -> None:
        """Do what the buttons say that were pressed, and fit the cameras of new browsers."""
        self.cameras.welcome()
        while self.panel.pressed:
            if self.panel.pressed.popleft() == SHOW_ALL:
                self._show_all()
            elif (name := self.panel.selected or "") in self._placement.rows:
                below = self._points(with_descendants(self._links, name))
                self.cameras.show(below, 4 * self._link_m)

    def _points(self, names: Collection[str]) -> NDArray[np.float64]:
        """Where frames and their shapes are in the scene, (n, 3) metres."""
        rows = [row for name in names if (row := self._placement.rows.get(name)) is not None]
        corners = self.models.corners(self._placement, names)
        return np.concatenate([self._placement.poses[rows, :3], corners]) - self.scene.origin
