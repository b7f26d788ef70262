"""Transforms point clouds, as tf2_sensor_msgs does, on the bytes of the message."""

from __future__ import annotations

import copy
from array import array
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf.errors import InvalidArgumentException

from .messages import transform_of, with_header

#: The number of 32-bit floats in sensor_msgs/PointField, and its size in bytes.
_FLOAT32: Final = 7
_FLOAT32_BYTES: Final = 4


def do_transform_cloud(cloud: Any, transform: Any) -> Any:
    """Transform a PointCloud2: the fields x, y and z of its points; the others are copied.

    The data is copied once; `bytes`, which cannot be changed in place, twice. A point with NaN
    stays NaN and in its place.

    Args:
        cloud: A PointCloud2, organised or not, of either byte order, with padding or without.
        transform: A TransformStamped, ``X_target_cloud``; metres.

    Returns:
        A copy of the message in the frame of `transform`, with data of the same type.

    Raises:
        InvalidArgumentException: x, y or z is missing or not of 32-bit floats, or the data is
            shorter than the message says; `field` names the message's field.
    """
    data = np.array(np.frombuffer(_buffer(cloud.data), np.uint8))  # the copy
    coordinates = _coordinates(cloud, data)
    shape = (cloud.height, cloud.width, 3)
    # One row: many rows without a point would take long.
    row = np.empty((cloud.height * cloud.width, 3), np.float64)
    points = row.reshape(shape)
    for axis, values in enumerate(coordinates):
        points[..., axis] = values
    points = transform_of(transform).apply(row).reshape(shape)
    with np.errstate(over="ignore"):  # beyond 32 bits is infinite, as in tf2
        for axis, values in enumerate(coordinates):
            values[...] = points[..., axis]

    # Not deepcopy of the whole, which would copy the data once more.
    out = copy.copy(cloud)
    out.header = copy.deepcopy(cloud.header)
    out.fields = copy.deepcopy(cloud.fields)
    out.data = _like(cloud.data, data)
    return with_header(out, transform)


def _coordinates(cloud: Any, data: NDArray[np.uint8]) -> list[NDArray[np.float32]]:
    """Views of x, y and z in the data, (height, width) each."""
    fields = {field.name: field for field in cloud.fields}
    width, height = cloud.width, cloud.height
    needed = (height - 1) * cloud.row_step + width * cloud.point_step if width and height else 0
    is_too_short = data.size < needed or (width * cloud.point_step > cloud.row_step and height > 1)
    if is_too_short or min(width, height) < 0:
        raise InvalidArgumentException(
            f"the cloud has {data.size:,} bytes of data, not the {needed:,} of {height:,} rows of "
            f"{width:,} points of {cloud.point_step} bytes, with rows {cloud.row_step:,} bytes "
            "apart",
            field="data",
            limit=needed,
            value=data.size,
        )
    views: list[NDArray[np.float32]] = []
    for name in ("x", "y", "z"):
        field = fields.get(name)
        if field is None:
            raise InvalidArgumentException(f"the cloud has no field {name!r}", field=name)
        if field.datatype != _FLOAT32 or field.count > 1:
            raise InvalidArgumentException(
                f"field {name!r} of the cloud has datatype {field.datatype} and count "
                f"{field.count}; only one 32-bit float (datatype {_FLOAT32}) can be transformed",
                field=name,
                value=field.datatype,
            )
        if not 0 <= field.offset <= cloud.point_step - _FLOAT32_BYTES:
            raise InvalidArgumentException(
                f"field {name!r} of the cloud is at byte {field.offset} of points of "
                f"{cloud.point_step} bytes",
                field=name,
                limit=cloud.point_step,
                value=field.offset,
            )
        kind = np.dtype(np.float32).newbyteorder(">" if cloud.is_bigendian else "<")
        if not width or not height:  # whatever bytes there are
            views.append(np.empty((height, width), kind))
            continue
        strides = (cloud.row_step, cloud.point_step)
        views.append(np.ndarray((height, width), kind, data, field.offset, strides))
    return views


def _buffer(data: Any) -> Any:
    """The data as an object with bytes; ROS's own messages have one already."""
    return bytes(data) if isinstance(data, list | tuple) else data


def _like(data: Any, changed: NDArray[np.uint8]) -> Any:
    """The changed bytes as an object of the type of `data`."""
    if isinstance(data, array):
        out = array(data.typecode)
        out.frombytes(changed.data)
        return out
    if isinstance(data, np.ndarray):
        return changed.view(data.dtype).reshape(data.shape)
    if isinstance(data, list | tuple):
        return type(data)(changed.tolist())
    return type(data)(changed.data) if isinstance(data, bytes | bytearray) else changed.data
