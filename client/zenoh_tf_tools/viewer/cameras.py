"""The cameras of the browsers that have the page open."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from zenoh_tf import Transform
from zenoh_tf_tools.viewer.camera import DEFAULT, FOV_RAD, Camera, fit


class Cameras:
    """Reads and moves the cameras. The viewer's thread calls its methods."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Give new browsers the viewer's field of view."""
        self._server = server
        self._initial = DEFAULT
        self._shown: tuple[NDArray[np.float64], float] = np.zeros((1, 3)), 1.0
        self._fitted = set[int]()  # the browsers whose cameras fit their windows
        server.initial_camera.fov = FOV_RAD

    def latest(self) -> Camera:
        """Return the camera that a person moved last; without a browser, a new one's."""
        clients = self._server.get_clients().values()
        handle = max((x.camera for x in clients), key=lambda x: x.update_timestamp, default=None)
        return self._initial if handle is None else _camera(handle)

    def show(self, points: NDArray[np.float64], least_m: float = 1.0) -> float:
        """Move all cameras so that they see these points, and those of browsers to come.

        Args:
            points: (n, 3) metres in the scene, at least one.
            least_m: The cameras are at least so far away, in metres.

        Returns:
            How far a camera is from the middle of them, in metres.
        """
        self._initial = fit(points, least_m=least_m)
        size_m = float(np.linalg.norm(self._initial.position - self._initial.look_at))
        initial = self._server.initial_camera
        initial.near, initial.far = size_m / 1000, size_m * 1000
        initial.position, initial.look_at = self._initial.position, self._initial.look_at
        self._shown = points, least_m
        self._fitted.clear()
        for number, client in self._server.get_clients().items():
            self._fit(number, client.camera)
        return size_m

    def welcome(self) -> None:
        """Fit the cameras of new browsers, which began with one for another window."""
        for number, client in self._server.get_clients().items():
            begins = np.allclose(client.camera.position, self._initial.position, rtol=1e-4)
            if begins and number not in self._fitted:
                self._fit(number, client.camera)

    def _fit(self, number: int, camera: viser.CameraHandle) -> None:
        self._fitted.add(number)
        points, least_m = self._shown
        fitted = fit(points, _camera(camera), least_m)
        camera.near, camera.far = self._server.initial_camera.near, self._server.initial_camera.far
        camera.position, camera.look_at = fitted.position, fitted.look_at


def _camera(handle: viser.CameraHandle) -> Camera:
    w, x, y, z = handle.wxyz
    rotation = Transform(rotation=(x, y, z, w)).matrix()[:3, :3]
    width, height = max(1, handle.image_width), max(1, handle.image_height)
    return Camera(np.array(handle.position), np.array(handle.look_at), rotation, width, height)
