"""The shapes of robots, at the frames of their links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from zenoh_tf import Transform
from zenoh_tf.urdf.kinematics import link_of
from zenoh_tf.urdf.visuals import Mesh, Shape, Solid, Visual
from zenoh_tf_tools.viewer.placement import Placement, array_of
from zenoh_tf_tools.viewer.scene import Node, linear

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
        self._nodes: dict[Model, Node] = {}

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
        rows: dict[Model, list[int]] = {
            model: [] for models in self._models.values() for model in models
        }
        for name in set(placement.names).difference(hidden) if opacity > 0 else ():
            for model in self._models_of(name):
                rows[model].append(placement.rows[name])
        for number, (model, found) in enumerate(rows.items()):
            self._draw(f"/models/{number}", model, placement.poses[sorted(found)], origin, opacity)

    def _draw(
        self,
        path: str,
        model: Model,
        X_fixed_frame: NDArray[np.float64],
        origin: NDArray[np.float64],
        opacity: float,
    ) -> None:
        """Draw a model at all of its frames: as instances, as `scene` says why."""
        node = self._nodes.get(model)
        if node is not None and len(node.sent["batched_positions"]) != len(X_fixed_frame):
            self._nodes.pop(model).handle.remove()
            node = None
        if not len(X_fixed_frame):
            return
        origins = array_of(np.tile(model.origin, (len(X_fixed_frame), 1)))
        poses = (array_of(X_fixed_frame) @ origins).poses
        where: dict[str, Any] = {
            "batched_wxyzs": poses[:, _WXYZ].astype(np.float32),
            "batched_positions": (poses[:, :3] - origin).astype(np.float32),
        }
        if node is None:
            handle = self._scene.add_batched_meshes_simple(
                path,
                model.vertices,
                model.faces,
                **where,
                batched_colors=linear(model.colour),
                flat_shading=True,
                side="double",
                lod="off",
            )
            node = self._nodes[model] = Node(handle, **where)
        node.set(**where, opacity=None if opacity == 1.0 else opacity)

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
        return self._models.get(link_of(frame, self._models) or "", ())


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
