"""The shapes of robots, at the frames of their links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from zenoh_tf import Transform
from zenoh_tf.urdf.visuals import Mesh, Shape, Solid, Visual
from zenoh_tf_tools.viewer.placement import Placement

_WXYZ: Final = [6, 3, 4, 5]
_GREY: Final = (0.75, 0.76, 0.8)


class ModelError(Exception):
    """A mesh that cannot be read; its text says which and why."""


class Model:
    """What is drawn at the frame of one link: triangles of one colour each, ready for viser."""

    def __init__(self, visual: Visual) -> None:
        """Read the shape.

        Raises:
            ModelError: Its mesh cannot be read.
        """
        self.link = visual.link
        self.origin = np.array(visual.origin.pose())
        mesh = _mesh(visual.shape)
        self.vertices, self.faces = mesh.vertices, mesh.faces
        #: (8, 3) the corners of its box in the frame of the link, metres.
        self.corners = visual.origin.apply(mesh.bounding_box.vertices)
        self.colour = visual.colour or _colour(mesh) or _GREY


class Models:
    """Draws models wherever a frame has the name of their link, with any prefix: PREFIX/LINK."""

    def __init__(self, scene: viser.SceneApi, models: Sequence[Model]) -> None:
        """Draw nothing yet."""
        self._scene = scene
        self._models: dict[str, list[Model]] = {}
        for model in models:
            self._models.setdefault(model.link, []).append(model)
        self._nodes: dict[str, _Drawn] = {}

    def draw(
        self,
        placement: Placement,
        origin: NDArray[np.float64],
        hidden: Iterable[str],
        opacity: float,
    ) -> None:
        """Draw the models of the frames that are placed.

        Args:
            placement: Where the frames are.
            origin: (3,) the scene's origin in the fixed frame, metres.
            hidden: Frames whose models are not drawn.
            opacity: From 0, which draws nothing, to 1.
        """
        if not self._models:
            return
        shown = set(placement.names).difference(hidden) if opacity > 0 else set()
        for name in shown - self._nodes.keys():
            models = self._models_of(name)
            if models:
                self._nodes[name] = _Drawn(self._scene, f"/models/{len(self._nodes)}", models)
        for name, node in self._nodes.items():
            pose = placement.poses[placement.rows[name]] if name in shown else None
            node.draw(None if pose is None else pose - (*origin, 0, 0, 0, 0), opacity)

    def corners(self, placement: Placement, names: Iterable[str]) -> NDArray[np.float64]:
        """Return the corners of the boxes of all models of these frames.

        Args:
            placement: Where the frames are.
            names: The frames; those that are not placed are left out.

        Returns:
            (n, 3) in the fixed frame, metres.
        """
        found = [np.empty((0, 3))]
        for name in names if self._models else ():
            row = placement.rows.get(name)
            if row is not None:
                X_fixed_frame = Transform.from_pose(placement.poses[row])
                found += [X_fixed_frame.apply(x.corners) for x in self._models_of(name)]
        return np.concatenate(found)

    def _models_of(self, frame: str) -> Sequence[Model]:
        """A robot's prefix ends with a slash, but a link's own name may have some, too."""
        parts = frame.split("/")
        for start in range(len(parts)):
            if models := self._models.get("/".join(parts[start:])):
                return models
        return ()


class _Drawn:
    """The nodes of one frame."""

    def __init__(self, scene: viser.SceneApi, path: str, models: Sequence[Model]) -> None:
        self._pose: Any = None
        self._opacity = -1.0
        self._frame: Any = scene.add_frame(path, show_axes=False)
        self._meshes: list[Any] = [
            scene.add_mesh_simple(
                f"{path}/{number}",
                model.vertices,
                model.faces,
                color=model.colour,
                flat_shading=True,
                side="double",
                position=model.origin[:3],
                wxyz=model.origin[_WXYZ],
            )
            for number, model in enumerate(models)
        ]

    def draw(self, pose: NDArray[np.float64] | None, opacity: float) -> None:
        """Draw them at a pose in the scene, or hide them."""
        if self._frame.visible != (pose is not None):
            self._frame.visible = pose is not None
        if pose is not None and not np.array_equal(pose, self._pose):
            self._pose = pose
            self._frame.position, self._frame.wxyz = pose[:3], pose[_WXYZ]
        if opacity != self._opacity:
            self._opacity = opacity
            for mesh in self._meshes:
                mesh.opacity = None if opacity == 1.0 else opacity


def _mesh(shape: Shape) -> Any:
    """The triangles of a shape, in metres."""
    match shape:
        case Mesh():
            return _loaded(shape)
        case Solid("box", sizes):
            return trimesh.creation.box(sizes)
        case Solid("cylinder", (radius, length)):
            return trimesh.creation.cylinder(radius, length)
        case Solid(_, (radius, *_)):
            return trimesh.creation.icosphere(3, radius)


def _loaded(shape: Mesh) -> Any:
    if shape.path is None:
        raise ModelError(
            f"mesh {shape.name!r} not found; a package is searched for in the folders above the "
            "URDF file and in AMENT_PREFIX_PATH and ROS_PACKAGE_PATH"
        )
    try:
        mesh: Any = trimesh.load(shape.path, force="mesh")
    except Exception as error:  # each format has exceptions of its own
        raise ModelError(f"cannot read the mesh {shape.path}: {error}") from error
    if not len(mesh.faces):
        raise ModelError(f"cannot read the mesh {shape.path}: it has no triangles")
    mesh.apply_scale(shape.scale)
    return mesh


def _colour(mesh: Any) -> tuple[float, float, float] | None:
    """The colour that a file gives to most of a mesh; None if it gives none."""
    if not mesh.visual.defined:
        return None
    red, green, blue = (np.asarray(mesh.visual.to_color().main_color)[:3] / 255).tolist()
    return red, green, blue
