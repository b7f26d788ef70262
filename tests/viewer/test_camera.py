"""The first picture: where the camera stands, and how large things are drawn."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from zenoh_tf_tools.viewer.camera import Camera, axes_m, fit, grid_cell_m, looking
from zenoh_tf_tools.viewer.cameras import Cameras

ROBOT = np.random.default_rng(7).uniform(-0.3, 0.3, (30, 3))


def window(width: int, height: int) -> Camera:
    return Camera(np.ones(3), np.zeros(3), np.eye(3), width, height)


@pytest.mark.parametrize("size", [(1600, 900), (960, 720), (400, 900)])
@pytest.mark.parametrize(
    "points",
    [
        ROBOT,
        1000 * ROBOT,
        ROBOT + np.array([50, 60, 0]),
        np.concatenate([ROBOT, [[20.0, 5.0, 0.0]]]),  # its map is further away than it is large
        np.array([[0.0, 0, 0], [0, 0, 2.0]]),
    ],
    ids=["robot", "site", "elsewhere", "map", "mast"],
)
def test_all_frames_are_in_the_window(points: np.ndarray, size: tuple[int, int]) -> None:
    camera = fit(points, window(*size))
    pixels, inside = camera.project(points)
    assert inside.all()
    # In its middle, and filling it in one direction.
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    np.testing.assert_allclose((low + high) / 2, np.array(size) / 2, rtol=0.1)
    assert max((high - low) / size) > 0.6


def test_a_frame_that_is_very_far_away_is_left_out() -> None:
    """A robot under the frame of the whole earth would be less than a pixel."""
    camera = fit(np.concatenate([ROBOT, [[6.4e6, 0, 0]]]))
    assert np.linalg.norm(camera.position - camera.look_at) < 3


def test_one_frame() -> None:
    camera = fit(np.array([[1.0, 2.0, 3.0]]))
    pixels, _ = camera.project(np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(pixels[0], (camera.width / 2, camera.height / 2), atol=1)


def test_what_is_behind_the_camera_is_not_seen() -> None:
    camera = fit(ROBOT)
    behind = camera.position + (camera.position - camera.look_at)
    assert not camera.project(behind[np.newaxis])[1].any()


def test_axes_fit_the_links_and_the_zoom() -> None:
    near, far = fit(ROBOT), fit(100 * ROBOT)
    assert axes_m(0.15, near) == pytest.approx(0.06, rel=0.2)
    assert 12 < axes_m(0.15, far) / far.metres_per_pixel < 24  # they can still be seen
    assert 50 < axes_m(9.0, near) / near.metres_per_pixel < 100  # they do not hide all else
    # Turning the wheel a little mostly changes nothing, and so sends nothing.
    assert len({axes_m(0.5, fit(ROBOT * (1 + i / 100))) for i in range(10)}) <= 2


@pytest.mark.parametrize(("size", "cell"), [(2, 1), (15, 1), (40, 10), (0.5, 0.1), (0, 0.0001)])
def test_the_grid(size: float, cell: float) -> None:
    assert grid_cell_m(size) == pytest.approx(cell)


def test_a_new_browser_gets_a_camera_for_its_window() -> None:
    """It begins with that of a wide one; not one that a person chose, or that was moved."""
    points = np.array([[-5.0, 0, 0], [5, 0, 0], [0, 5, 0], [0, -5, 0]])
    browsers: dict[int, Any] = {}
    server: Any = SimpleNamespace(initial_camera=SimpleNamespace(), get_clients=lambda: browsers)
    cameras = Cameras(server)
    cameras.show(points)
    first = server.initial_camera
    for number, position in enumerate((first.position, first.position + 1)):
        size = {"image_width": 390, "image_height": 844, "wxyz": (1, 0, 0, 0)}
        camera = SimpleNamespace(position=position, look_at=first.look_at, **size)
        browsers[number] = SimpleNamespace(camera=camera)
    cameras.welcome()
    fitted, chosen = browsers[0].camera, browsers[1].camera
    for camera, is_seen in ((fitted, True), (chosen, False)):
        _, inside = looking(camera.position, camera.look_at, window(390, 844)).project(points)
        assert inside.all() == is_seen
    fitted.position = first.position  # by a person
    cameras.welcome()
    np.testing.assert_array_equal(fitted.position, first.position)
