"""``zenoh-tf view`` in a real browser, without a screen."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.processes.ports import free_port
from tests.recordings.files import write
from tests.support.command_line import started

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium"),
    pytest.mark.timeout(240),  # a machine without a graphics processor draws slowly
]
#: map -> base moves; base -> tool stops after 1 s and is far enough to be a long red line.
LOG = [
    *[(i / 10, "/tf", [("map", "base", 1 + i / 10, i / 20)]) for i in range(51)],
    *[(i / 10, "/tf", [("base", "tool", 1 + i / 10, 2.0)]) for i in range(11)],
]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    path = write(tmp_path_factory.mktemp("recording") / "run", LOG)
    port = free_port()
    with started("view", str(path), "--at", "+4.5s", "--port", str(port)) as _:
        yield f"http://127.0.0.1:{port}"


@pytest.fixture(scope="module")
def page(url: str) -> Iterator[Any]:
    """The page, and in `asked` what it has asked for."""
    software = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=software)
        page = browser.new_page(viewport={"width": 900, "height": 600})
        page.set_default_timeout(90_000)
        page.asked = []
        page.on("request", lambda request: page.asked.append(request.url))
        page.goto(url)
        page.get_by_text("3 frames, 2 moving").wait_for()
        yield page
        browser.close()


def pixels(page: Any) -> np.ndarray[Any, Any]:
    """What is drawn left of the panel, as (height, width, 3) colours."""
    image = pytest.importorskip("PIL.Image")
    shot = page.screenshot(clip={"x": 0, "y": 0, "width": 560, "height": 600}, timeout=90_000)
    colours: np.ndarray[Any, Any] = np.asarray(image.open(io.BytesIO(shot)).convert("RGB"))
    return colours.astype(int)


def wait_for_colours(page: Any) -> None:
    """Wait until a stale red link and a blue trail are drawn."""
    for _ in range(60):
        red, green, blue = np.moveaxis(pixels(page), 2, 0)
        is_red = (red > 180) & (green < 70) & (blue < 90)
        is_blue = (blue > 180) & (red < 130) & (green < 180)
        if is_red.sum() > 50 and is_blue.sum() > 50:
            return
        page.wait_for_timeout(500)
    raise AssertionError(f"{is_red.sum()} red and {is_blue.sum()} blue pixels")


def test_a_person_sees_a_stale_link_and_a_trail(page: Any, url: str) -> None:
    page.goto(f"{url}/?initialCameraPosition=2.5,-1.5,2&initialCameraLookAt=3,0,0")
    page.get_by_text("1 stale (over 1 s): tool").wait_for()
    wait_for_colours(page)


def test_the_first_picture_shows_the_whole_tree(page: Any, url: str) -> None:
    """Without a camera that the test chooses; and the panel is beside it, not over it."""
    page.goto(url)
    page.get_by_text("1 stale (over 1 s): tool").wait_for()
    wait_for_colours(page)
    canvas = page.locator("canvas").first.bounding_box()
    panel = page.get_by_text("fixed frame").first.bounding_box()
    assert canvas["x"] + canvas["width"] <= panel["x"]


def test_a_frame_can_be_hidden(page: Any, url: str) -> None:
    page.goto(f"{url}/?initialCameraPosition=2.5,-1.5,2&initialCameraLookAt=3,0,0")
    page.get_by_text("frames", exact=True).first.click(force=True)
    page.get_by_text("3 of 3 frames").wait_for()
    page.locator("label", has_text="tool").last.click(force=True)
    page.get_by_text("3 of 3 frames, 1 hidden").wait_for()
    page.locator("label", has_text="tool").last.click(force=True)
    page.get_by_text("3 of 3 frames", exact=True).wait_for()


def test_a_frame_can_be_clicked(page: Any, url: str) -> None:
    """The fixed frame's origin is where the camera looks: in the middle of the scene."""
    page.goto(f"{url}/?initialCameraPosition=0.3,0.3,0.3&initialCameraLookAt=0,0,0")
    page.get_by_text("3 frames, 2 moving").wait_for()
    figures = page.get_by_text("none, it is a root")
    for _ in range(60):
        canvas = page.locator("canvas").first.bounding_box()
        page.mouse.click(canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2)
        page.wait_for_timeout(1000)
        if figures.count():
            return
    raise AssertionError("no figures after 60 clicks")


def test_nothing_comes_from_elsewhere_and_nothing_can_be_shared(page: Any, url: str) -> None:
    assert page.asked
    here = (url, url.replace("http", "ws"), f"blob:{url}", "data:")
    assert [asked for asked in page.asked if not asked.startswith(here)] == []
    assert page.get_by_text("Share").count() == 0
    assert page.locator("[aria-label*=hare]").count() == 0
