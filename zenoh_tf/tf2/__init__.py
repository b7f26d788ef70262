"""The Python API of tf2_ros: a script changes its imports and runs, without a server or with one.

    import zenoh_tf.tf2 as tf2_ros                     # was: import tf2_ros
    from zenoh_tf.tf2.buffer import Buffer             # was: from tf2_ros.buffer import ...

A `Buffer` has a tree of its own, which a `TransformListener` fills. After `connect` buffers and
broadcasters are on the tree of a server. ROS is imported for nodes of rclpy only. A message is any
object with a message's attributes. A time is any object with `.nanoseconds` (rclpy) or `.sec` and
`.nanosec` (builtin_interfaces), or a number of seconds. Results are the plain classes of
`messages`. docs/how-to/from-tf2.md lists the differences from tf2.
"""

from zenoh_tf.errors import (
    BackwardExtrapolationException,
    ConnectivityException,
    ExtrapolationException,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LookupException,
    NoDataForExtrapolationException,
    TimeoutException,
    TransformException,
)

from .buffer import Buffer, BufferInterface, NotImplementedException
from .buffer_client import BufferClient
from .clouds import do_transform_cloud
from .future import TransformFuture
from .message_filter import FilterFailureReason, MessageFilter, TransformFilter
from .messages import (
    Header,
    Point,
    PointStamped,
    Pose,
    PoseStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
    fill,
)
from .sources import close, connect
from .static_transform_broadcaster import StaticTransformBroadcaster
from .times import Duration, Time
from .transform_broadcaster import TransformBroadcaster
from .transform_listener import StaticTransformListener, TransformListener
from .transforming import (
    TransformRegistration,
    TypeException,
    do_transform_point,
    do_transform_polygon_stamped,
    do_transform_pose,
    do_transform_pose_stamped,
    do_transform_pose_with_covariance_stamped,
    do_transform_vector3,
    do_transform_wrench,
)

__all__ = [
    "BackwardExtrapolationException",
    "Buffer",
    "BufferClient",
    "BufferInterface",
    "ConnectivityException",
    "Duration",
    "ExtrapolationException",
    "FilterFailureReason",
    "ForwardExtrapolationException",
    "Header",
    "InvalidArgumentException",
    "LookupException",
    "MessageFilter",
    "NoDataForExtrapolationException",
    "NotImplementedException",
    "Point",
    "PointStamped",
    "Pose",
    "PoseStamped",
    "Quaternion",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "Time",
    "TimeoutException",
    "Transform",
    "TransformBroadcaster",
    "TransformException",
    "TransformFilter",
    "TransformFuture",
    "TransformListener",
    "TransformRegistration",
    "TransformStamped",
    "TypeException",
    "Vector3",
    "close",
    "connect",
    "do_transform_cloud",
    "do_transform_point",
    "do_transform_polygon_stamped",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "do_transform_wrench",
    "fill",
]
