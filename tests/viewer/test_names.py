"""Each name is at its frame in a real browser, while 30 frames move and while they are paused.

The frames jump between pictures, each within a cell of its own. So what is drawn of one picture at
the places of another one is tens of pixels away, however fast the browser draws.
"""

from __future__ import annotations

import contextlib
import io
import math
import shutil
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.viewer.viewers import S, Tree, opened
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_tools.viewer.camera import FOV_RAD

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
image = pytest.importorskip("PIL.Image")

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium"),
    pytest.mark.timeout(400),  # a machine without a graphics processor draws slowly
]
COUNT = 30
#: Most pixels between a frame's origin and its name.
NEAR = 20.0


@dataclass(frozen=True)
class Window:
    """A browser's window, and how the frames are spread in it.

    Attributes:
        options: Of playwright's page.
        columns: How many cells there are in a row.
        area: (2,) pixels, width and height of all cells.
        jump: (2,) pixels that a frame moves at most from the middle of its cell.
        height_m: How high above the frames the camera is. Axes of 0.2 m stay within a cell.
    """

    options: Mapping[str, Any]
    columns: int
    area: tuple[int, int]
    jump: tuple[float, float]
    height_m: float

    @property
    def cell(self) -> NDArray[np.float64]:
        return np.array(self.area) / (self.columns, COUNT // self.columns)

    def middles(self) -> NDArray[np.float64]:
        """(30, 2) pixels."""
        rows, columns = np.divmod(np.arange(COUNT), self.columns)
        return (np.stack([columns, rows], axis=1) + 0.5) * self.cell


DESKTOP = Window({"viewport": {"width": 900, "height": 600}}, 5, (575, 600), (20, 18), 5.0)
PHONE = Window(
    {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True},
    3,
    (390, 780),
    (25, 14),
    9.0,
)


class Mover:
    """Moves the frames before each picture, and draws it."""

    def __init__(self, viewer: Any, tree: Tree) -> None:
        self._viewer, self._tree = viewer, tree
        self._chance = np.random.default_rng(3)
        self._ended = threading.Event()
        self._window = DESKTOP
        self._canvas = (575.0, 600.0)

    def spread(self, window: Window, canvas: Any) -> None:
        """Fit the frames to a window from now on."""
        self._window, self._canvas = window, (canvas["width"], canvas["height"])

    def step(self) -> None:
        window, (width, height) = self._window, self._canvas
        pixels = window.middles() + self._chance.uniform(-1, 1, (COUNT, 2)) * window.jump
        per_pixel = 2 * window.height_m * math.tan(FOV_RAD / 2) / height
        self._tree.time_ns += S // 20
        for number, (x, y) in enumerate((pixels - (width / 2, height / 2)) * (1, -1) * per_pixel):
            # Turned by half, so that names, which are right of and above, hide none of the axes.
            pose = Transform.from_rpy(0, 0, math.pi, (x, y, 0))
            stamped = StampedTransform("map", f"f{number:02}", self._tree.time_ns, pose)
            self._tree.lookups.set_transform(stamped)
        self._viewer.step()

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        def run() -> None:
            while not self._ended.wait(0.05):
                self.step()

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            self._ended.set()
            thread.join()


@pytest.fixture
def mover(viser_server: Any, tree: Tree) -> Iterator[Mover]:
    with opened(viser_server, tree) as viewer:
        mover = Mover(viewer, tree)
        mover.step()
        viewer.panel.trail.value = 0.0
        viewer.panel.frames.unchecked.add("map")  # and so no links that cross the cells
        viewer._fit_until_s = 0.0
        with mover.running():
            yield mover


def distances(page: Any, window: Window) -> NDArray[np.float64]:
    """How far each name is from its frame, as drawn, in pixels; NaN if one of them is not seen."""
    return measured(page.screenshot(timeout=120_000), window)


def measured(shot: bytes, window: Window) -> NDArray[np.float64]:
    drawn = np.asarray(image.open(io.BytesIO(shot)).convert("RGB")).astype(int)
    found = np.full(COUNT, np.nan)
    for number, (x, y) in enumerate(window.middles()):
        half = window.cell / 2
        area = drawn[int(y - half[1]) : int(y + half[1]), int(x - half[0]) : int(x + half[0])]
        red, green, blue = np.moveaxis(area, 2, 0)
        ink = np.argwhere((area.max(axis=2) < 140) & (np.ptp(area, axis=2) < 20))
        axis_x = np.argwhere((red > green + 40) & (red > blue + 40))
        axis_y = np.argwhere((green > red + 25) & (green > blue + 25))
        if len(ink) and len(axis_x) and len(axis_y):
            # The x axis goes left from the origin, and y down.
            origin = np.array([np.median(axis_x[:, 0]), np.median(axis_y[:, 1])])
            # Its lower left corner; what is grey of an axis is few pixels.
            corner = np.array([np.percentile(ink[:, 0], 95), np.percentile(ink[:, 1], 5)])
            found[number] = np.linalg.norm(corner - origin)
    return found


def magenta(page: Any, window: Window) -> int:
    """How many pixels there are of viser's tool for the camera's centre, which fills the scene."""
    drawn = np.asarray(image.open(io.BytesIO(page.screenshot(timeout=120_000))).convert("RGB"))
    red, green, blue = np.moveaxis(drawn[: window.area[1], : window.area[0]].astype(int), 2, 0)
    return int(((red > green + 40) & (blue > green + 40)).sum())


def seen(page: Any, window: Window) -> NDArray[np.float64]:
    """The distances as soon as all names are drawn."""
    for _ in range(60):
        found = distances(page, window)
        if not np.isnan(found).any():
            return found
        for note in page.locator(".mantine-Notification-closeButton").all():
            note.evaluate("button => button.click()")  # that there is no graphics processor
        page.wait_for_timeout(500)
    raise AssertionError(f"{np.isnan(found).sum()} names or frames are not seen")


@pytest.mark.parametrize("window", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_names_are_at_their_frames(viser_server: Any, mover: Mover, window: Window) -> None:
    software = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=software)
        page = browser.new_context(**window.options).new_page()
        page.set_default_timeout(120_000)
        camera = f"initialCameraPosition=0,-0.01,{window.height_m}&initialCameraLookAt=0,0,0"
        page.goto(f"http://127.0.0.1:{viser_server.get_port()}/?{camera}")
        page.get_by_text("31 frames, 30 moving").wait_for(state="attached")
        mover.spread(window, page.locator("canvas").first.bounding_box())
        shots = [seen(page, window) for _ in range(5)]
        assert np.max(shots) <= NEAR
        page.get_by_label("live").evaluate("box => box.click()")
        page.wait_for_timeout(2000)
        paused = seen(page, window)
        assert np.max(paused) <= NEAR
        assert magenta(page, window) < 300  # some are where a red and a blue axis cross
        print(f"running {np.max(shots):.1f} px, paused {np.max(paused):.1f} px")
        browser.close()
