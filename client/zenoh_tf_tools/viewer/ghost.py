"""The picked frame as it is now by an estimate: pale axes, and a ball that it is in."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import viser
from numpy.typing import NDArray
from trimesh.creation import cylinder

from zenoh_tf import Estimate

_WXYZ: Final = [6, 3, 4, 5]
#: The axes' colours, and how they and the ball let light through.
_COLOURS: Final = np.array([(200, 0, 0), (0, 130, 0), (0, 0, 200)], np.uint8)
_PALE: Final = 0.5
_BALL: Final = (220, 90, 0)
_BALL_PALE: Final = 0.35
#: Quarter turns (w, x, y, z) that turn z into x, into y, and none.
_HALF: Final = math.sqrt(0.5)
_TURNS: Final = np.array(
    [(_HALF, 0, _HALF, 0), (_HALF, -_HALF, 0, 0), (1, 0, 0, 0)], dtype=np.float32
)


class Ghost:
    """Draws one estimate, or none. Only the viewer's thread calls it."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Draw nothing yet."""
        rod = cylinder(0.03, segment=[(0, 0, 0), (0, 0, 1)], sections=12)
        self._frame: Any = scene.add_frame("/ghost", show_axes=False, visible=False)
        self._axes: Any = scene.add_batched_meshes_simple(
            "/ghost/axes",
            rod.vertices,
            rod.faces,
            _TURNS,
            np.zeros((3, 3), np.float32),
            batched_colors=_COLOURS,
            opacity=_PALE,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._ball: Any = scene.add_icosphere(
            "/ghost/ball",
            1.0,
            _BALL,
            opacity=_BALL_PALE,
            cast_shadow=False,
            receive_shadow=False,
        )

    def draw(self, found: Estimate | None, origin: NDArray[np.float64], axes_m: float) -> None:
        """Draw an estimate.

        Args:
            found: The estimate in the fixed frame. Nothing is drawn of one that has no error, as
                the frame itself shows it, or no bound, nor if it is None.
            origin: (3,) the scene's origin in the fixed frame, metres.
            axes_m: Length of the axes in metres.
        """
        shown = found is not None and 0 < found.error_m < math.inf
        if self._frame.visible != shown:
            self._frame.visible = shown
        if found is None or not shown:
            return
        pose = np.array(found.transform.pose())
        self._frame.position, self._frame.wxyz = pose[:3] - origin, pose[_WXYZ]
        self._ball.scale = found.error_m
        if self._axes.scale != axes_m:
            self._axes.scale = axes_m
