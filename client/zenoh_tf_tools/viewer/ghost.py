"""The picked frame as it is now by an estimate: pale axes, and a ball that it is in."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import viser
from numpy.typing import NDArray
from trimesh.creation import cylinder, icosphere

from zenoh_tf import Estimate, Transform
from zenoh_tf_tools.viewer.scene import Node, linear

_WXYZ: Final = [6, 3, 4, 5]
#: The axes' colours, and how they and the ball let light through.
_COLOURS: Final = np.array([(200, 0, 0), (0, 130, 0), (0, 0, 200)], np.uint8)
_PALE: Final = 0.5
_BALL: Final = linear((220 / 255, 90 / 255, 0))
_BALL_PALE: Final = 0.35
#: They turn z into x, into y, and not at all.
_TURNS: Final = (
    Transform.from_rpy(0, math.pi / 2, 0),
    Transform.from_rpy(-math.pi / 2, 0, 0),
    Transform(),
)


class Ghost:
    """Draws one estimate, or none. Only the viewer's thread calls it."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Draw nothing yet."""
        rod = cylinder(0.03, segment=[(0, 0, 0), (0, 0, 1)], sections=12)

        def add(name: str, shape: Any, count: int, **look: Any) -> Node:
            none = np.zeros(count, np.float32)
            turns = np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))
            options: Any = {"lod": "off", "cast_shadow": False, "receive_shadow": False, **look}
            places = np.zeros((count, 3), np.float32)
            return Node(
                scene.add_batched_meshes_simple(
                    name, shape.vertices, shape.faces, turns, places, batched_scales=none, **options
                )
            )

        self._axes = add("/ghost/axes", rod, 3, batched_colors=_COLOURS, opacity=_PALE)
        ball = icosphere(subdivisions=3)
        self._ball = add("/ghost/ball", ball, 1, batched_colors=_BALL, opacity=_BALL_PALE)

    def draw(self, found: Estimate | None, origin: NDArray[np.float64], axes_m: float) -> None:
        """Draw an estimate.

        Args:
            found: The estimate in the fixed frame. Nothing is drawn of one that has no error, as
                the frame itself shows it, or no bound, nor if it is None.
            origin: (3,) the scene's origin in the fixed frame, metres.
            axes_m: Length of the axes in metres.
        """
        if found is None or not 0 < found.error_m < math.inf:
            self._axes.set(batched_scales=np.zeros(3, np.float32))
            self._ball.set(batched_scales=np.zeros(1, np.float32))
            return
        X_fixed_now = found.transform
        position = np.array(X_fixed_now.translation) - origin
        turns = [(X_fixed_now @ turn).pose() for turn in _TURNS]
        self._axes.set(
            batched_positions=np.tile(position, (3, 1)).astype(np.float32),
            batched_wxyzs=np.array(turns)[:, _WXYZ].astype(np.float32),
            batched_scales=np.full(3, axes_m, np.float32),
        )
        self._ball.set(
            batched_positions=position[None].astype(np.float32),
            batched_scales=np.array([found.error_m], np.float32),
        )
