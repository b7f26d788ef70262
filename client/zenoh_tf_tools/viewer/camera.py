"""Where cameras stand, what they see, and how large things are drawn for them.

Coordinates are those of the scene: of the fixed frame, shifted by the scene's origin. A camera's
axes are x right, y down, z forward, as in OpenCV.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf_tools.viewer.placement import Placement
from zenoh_tf_tools.viewer.source import ViewedLink

#: The vertical field of view of all cameras, in radians.
FOV_RAD: Final = math.radians(50.0)
#: From where a new camera looks: behind, from the right, and above.
_FROM: Final = np.array([-0.55, -0.55, 0.63])
#: How much of the window the frames fill at most; the rest is for axes and names.
_FILLED: Final = 0.8
#: Frames further away than so many times the distance that four fifths of them keep are not
#: fitted: the centre of the earth would make a robot smaller than a pixel.
_FAR: Final = 200.0
#: Axes are as long as this part of a typical link, but at least and at most so many pixels.
_OF_LINK: Final = 0.4
_LEAST_PIXELS: Final = 16.0
_MOST_PIXELS: Final = 70.0
#: The extent of a tree whose frames are all in one place, in metres.
_LEAST_EXTENT_M: Final = 0.5


@dataclass(frozen=True)
class Camera:
    """A camera and its window.

    Attributes:
        position: (3,) metres.
        look_at: (3,) the point in the middle of the window, metres.
        rotation: (3, 3) the camera's axes in those of the scene, as columns.
        width: Of the window, in pixels.
        height: Of the window, in pixels.
    """

    position: NDArray[np.float64]
    look_at: NDArray[np.float64]
    rotation: NDArray[np.float64]
    width: int = 1000
    height: int = 750

    @property
    def metres_per_pixel(self) -> float:
        """The length that one pixel shows, at the distance of the point it looks at."""
        distance = float(np.linalg.norm(self.look_at - self.position))
        return 2 * distance * math.tan(FOV_RAD / 2) / self.height

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return where points are seen.

        Args:
            points: (n, 3) metres.

        Returns:
            (n, 2) pixels from the upper left corner, and (n,) whether they are in the window.
        """
        seen = (points - self.position) @ self.rotation
        depth = seen[:, 2]
        focal = self.height / 2 / math.tan(FOV_RAD / 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = seen[:, :2] / depth[:, None] * focal + (self.width / 2, self.height / 2)
        inside = (pixels >= 0).all(axis=1) & (pixels < (self.width, self.height)).all(axis=1)
        return pixels, inside & (depth > 0)


def looking(position: NDArray[np.float64], at: NDArray[np.float64], window: Camera) -> Camera:
    """Return the camera at a position that looks at a point, upright, with another's window."""
    forward = (at - position) / np.linalg.norm(at - position)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    return Camera(position, at, np.stack([right, down, forward], 1), window.width, window.height)


#: A window before the browser has said how large its own is.
DEFAULT: Final = looking(3 * _FROM, np.zeros(3), Camera(np.zeros(3), np.zeros(3), np.eye(3)))


def bounds(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (2, 3) of the box of all points (n, 3) but those very far away."""
    distances = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    typical = max(float(np.quantile(distances, 0.8)), _LEAST_EXTENT_M)
    near = points[distances <= _FAR * typical]
    return np.array([near.min(axis=0), near.max(axis=0)])


def fit(
    points: NDArray[np.float64], window: Camera = DEFAULT, least_m: float = _LEAST_EXTENT_M
) -> Camera:
    """Return the nearest camera that has all points in its window, and them in the middle.

    Args:
        points: (n, 3) metres, at least one; those very far from the others are left out.
        window: A camera with the window.
        least_m: The camera is at least so far away, in metres.
    """
    low, high = bounds(points)
    points = points[((points >= low) & (points <= high)).all(axis=1)]
    rotation = looking(_FROM, np.zeros(3), window).rotation
    centre, distance = (low + high) / 2, least_m
    tangent = math.tan(FOV_RAD / 2) * _FILLED
    # What is near is further from the middle of the window than it is from that of the points, so
    # the two are found by turns.
    for _ in range(5):
        across, down, forward = ((points - centre) @ rotation).T
        needed = np.maximum(abs(across) * window.height / window.width, abs(down)) / tangent
        distance = max(float((needed - forward).max()), least_m)
        seen = np.stack([across, down]) / (forward + distance)
        aside = (seen.min(axis=1) + seen.max(axis=1)) / 2 * distance
        centre = centre + rotation[:, :2] @ aside
    return looking(centre + 1.02 * distance * _FROM, centre, window)


def typical_link_m(placement: Placement, links: Mapping[str, ViewedLink]) -> float:
    """Return the median length of the links in metres; 0 without any."""
    ends = [
        (row, placement.rows[parent])
        for name, row in placement.rows.items()
        if (parent := links[name].parent) is not None and parent in placement.rows
    ]
    if not ends:
        return 0.0
    rows = np.array(ends)
    positions = placement.poses[:, :3]
    lengths = np.linalg.norm(positions[rows[:, 0]] - positions[rows[:, 1]], axis=1)
    longer = lengths[lengths > 1e-6]
    return float(np.median(longer)) if len(longer) else 0.0


def axes_m(link_m: float, camera: Camera) -> float:
    """Return how long to draw axes, in metres: one of few lengths, as each change is sent.

    Args:
        link_m: The length of a typical link, metres.
        camera: The camera.
    """
    pixel_m = camera.metres_per_pixel
    length = min(max(_OF_LINK * link_m, _LEAST_PIXELS * pixel_m), _MOST_PIXELS * pixel_m)
    return float(2.0 ** (round(2 * math.log2(length)) / 2))


def grid_cell_m(size_m: float) -> float:
    """Return a cell's size of 1, 10, 100 ... metres or a part, for a scene of this size."""
    return float(10.0 ** math.floor(math.log10(max(size_m, 1e-3) / 2)))
