"""Transforms stamped messages, as tf2_geometry_msgs does, by their attributes.

Each function returns a copy of the message. The copy has the header of the transform: the frame
that the transform maps to, and its time.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import zenoh_tf

from .clouds import do_transform_cloud
from .messages import transform_of, with_header

#: Transforms a message of one type: (message, TransformStamped) -> transformed copy.
Function = Callable[[Any, Any], Any]

#: What scripts have registered.
_registered: dict[type, Function] = {}


class TypeException(Exception):
    """The message is of a kind that cannot be transformed."""


class TransformRegistration:
    """Makes `Buffer.transform` transform messages of further types, as in tf2_ros.

    All instances share one table. A registered type comes before what the shim recognises by its
    attributes, and stands for its subclasses.

    Thread safety: all methods.

    Example:
        ``TransformRegistration().add(Plane, do_transform_plane)``
    """

    def add(self, key: type, callback: Function) -> None:
        """Register the function that transforms a type.

        Args:
            key: The type of the messages. They need a `header`.
            callback: Takes a message and a TransformStamped, ``X_target_source``; returns the
                transformed copy.
        """
        _registered[key] = callback

    def get(self, key: type) -> Function:
        """Return the function that transforms a type.

        Args:
            key: The type of a message.

        Returns:
            The registered function, else one of this module if the type has the attributes of
            one of its messages.

        Raises:
            TypeException: There is none.
        """
        found = _by_type(key) or _by_attributes(key)
        if found is None:
            raise TypeException(
                f"cannot transform a {key.__name__}; TransformRegistration().add registers types"
            )
        return found


def do_transform(message: Any, transform: Any) -> Any:
    """Transform a message of a registered type, or of one that its attributes show.

    Raises TypeException for another kind of message.
    """
    # Not by the attributes of its type, which may lack those of its instances.
    function = _by_type(type(message)) or _by_attributes(message)
    return (function or TransformRegistration().get(type(message)))(message, transform)


def do_transform_point(point: Any, transform: Any) -> Any:
    """Transform a PointStamped."""
    out = copy.deepcopy(point)
    _set_xyz(out.point, transform_of(transform).apply(_xyz(out.point)))
    return with_header(out, transform)


def do_transform_vector3(vector3: Any, transform: Any) -> Any:
    """Transform a Vector3Stamped: rotate it, since it is a direction."""
    out = copy.deepcopy(vector3)
    _set_xyz(out.vector, transform_of(transform).apply_vectors(_xyz(out.vector)))
    return with_header(out, transform)


def do_transform_pose(pose: Any, transform: Any) -> Any:
    """Transform a Pose, which has no header, or a PoseStamped, as older releases of tf2 do."""
    if hasattr(pose, "header"):
        return do_transform_pose_stamped(pose, transform)
    out = copy.deepcopy(pose)
    q = out.orientation
    moved = transform_of(transform) @ zenoh_tf.Transform(_xyz(out.position), (q.x, q.y, q.z, q.w))
    _set_xyz(out.position, moved.translation)
    q.x, q.y, q.z, q.w = moved.rotation.tolist()
    return out


def do_transform_pose_stamped(pose: Any, transform: Any) -> Any:
    """Transform a PoseStamped."""
    out = copy.deepcopy(pose)
    out.pose = do_transform_pose(out.pose, transform)
    return with_header(out, transform)


def do_transform_pose_with_covariance_stamped(pose: Any, transform: Any) -> Any:
    """Transform a PoseWithCovarianceStamped.

    The covariance is rotated; the lever arm between the two origins is ignored, as in tf2.
    """
    out = copy.deepcopy(pose)
    out.pose.pose = do_transform_pose(out.pose.pose, transform)
    covariance = np.asarray(out.pose.covariance, np.float64).reshape(6, 6)
    rotated = transform_of(transform).apply_covariance(covariance)
    out.pose.covariance = rotated.ravel().tolist()
    return with_header(out, transform)


def do_transform_polygon_stamped(polygon: Any, transform: Any) -> Any:
    """Transform a PolygonStamped: each of its points."""
    out = copy.deepcopy(polygon)
    points = out.polygon.points
    if len(points):
        moved = transform_of(transform).apply([_xyz(point) for point in points])
        for point, values in zip(points, moved, strict=True):
            _set_xyz(point, values)
    return with_header(out, transform)


def do_transform_wrench(wrench: Any, transform: Any) -> Any:
    """Transform a WrenchStamped: the equal wrench at the origin of the other frame.

    The torque gets the share of the force and of the lever arm between the two origins, as in tf2.
    """
    out = copy.deepcopy(wrench)
    force, torque = out.wrench.force, out.wrench.torque
    moved = transform_of(transform).apply_wrench((*_xyz(force), *_xyz(torque)))
    _set_xyz(force, moved[:3])
    _set_xyz(torque, moved[3:])
    return with_header(out, transform)


def _by_type(kind: type) -> Function | None:
    return next((_registered[base] for base in kind.__mro__ if base in _registered), None)


def _by_attributes(message: Any) -> Function | None:
    """The function for a message, or for a type whose fields are attributes of the class."""
    if hasattr(message, "point_step"):
        return do_transform_cloud
    if hasattr(message, "point"):
        return do_transform_point
    if hasattr(message, "vector"):
        return do_transform_vector3
    if hasattr(message, "polygon"):
        return do_transform_polygon_stamped
    if hasattr(message, "wrench"):
        return do_transform_wrench
    if hasattr(message, "pose"):
        return _do_transform_any_pose
    return None


def _do_transform_any_pose(message: Any, transform: Any) -> Any:
    if hasattr(message.pose, "covariance"):
        return do_transform_pose_with_covariance_stamped(message, transform)
    return do_transform_pose_stamped(message, transform)


def _xyz(point: Any) -> tuple[float, float, float]:
    return point.x, point.y, point.z


def _set_xyz(point: Any, values: NDArray[np.float64]) -> None:
    point.x, point.y, point.z = values.tolist()
