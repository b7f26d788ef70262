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

from .messages import Header, fill, nanoseconds, time_of, transform_of


class TypeException(Exception):
    """The message is of a kind that cannot be transformed."""


def do_transform(message: Any, transform: Any) -> Any:
    """Transform any of the stamped messages below, recognised by its attributes.

    Raises TypeException for another kind of message.
    """
    return _function(message)(message, transform)


def do_transform_point(point: Any, transform: Any) -> Any:
    """Transform a PointStamped."""
    out = copy.deepcopy(point)
    _set_xyz(out.point, transform_of(transform).apply(_xyz(out.point)))
    return _with_header(out, transform)


def do_transform_vector3(vector3: Any, transform: Any) -> Any:
    """Transform a Vector3Stamped: rotate it, since it is a direction."""
    out = copy.deepcopy(vector3)
    _set_xyz(out.vector, transform_of(transform).apply_vectors(_xyz(out.vector)))
    return _with_header(out, transform)


def do_transform_pose(pose: Any, transform: Any) -> Any:
    """Transform a Pose, which has no header."""
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
    return _with_header(out, transform)


def do_transform_pose_with_covariance_stamped(pose: Any, transform: Any) -> Any:
    """Transform a PoseWithCovarianceStamped.

    The covariance is rotated; the lever arm between the two origins is ignored, as in tf2.
    """
    out = copy.deepcopy(pose)
    out.pose.pose = do_transform_pose(out.pose.pose, transform)
    covariance = np.asarray(out.pose.covariance, np.float64).reshape(6, 6)
    rotated = transform_of(transform).apply_covariance(covariance)
    out.pose.covariance = rotated.ravel().tolist()
    return _with_header(out, transform)


def _function(message: Any) -> Callable[[Any, Any], Any]:
    if hasattr(message, "point"):
        return do_transform_point
    if hasattr(message, "vector"):
        return do_transform_vector3
    if hasattr(message, "pose"):
        if hasattr(message.pose, "covariance"):
            return do_transform_pose_with_covariance_stamped
        return do_transform_pose_stamped
    raise TypeException(f"cannot transform a {type(message).__name__}")


def _xyz(point: Any) -> tuple[float, float, float]:
    return point.x, point.y, point.z


def _set_xyz(point: Any, values: NDArray[np.float64]) -> None:
    point.x, point.y, point.z = values.tolist()


def _with_header(message: Any, transform: Any) -> Any:
    header = transform.header
    fill(message.header, Header(time_of(nanoseconds(header.stamp)), header.frame_id))
    return message
