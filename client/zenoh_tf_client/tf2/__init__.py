"""The Python API of tf2_ros on a `TransformClient`: a script changes its imports and runs.

    import zenoh_tf_client.tf2 as tf2_ros                     # was: import tf2_ros
    from zenoh_tf_client.tf2.buffer import Buffer             # was: from tf2_ros.buffer import ...

No ROS is needed or imported. A message is any object with a message's attributes. A time is any
object with `.nanoseconds` (rclpy) or `.sec` and `.nanosec` (builtin_interfaces). Results are
the plain classes of `messages`. The environment variables ZENOH_TF_CONNECT and ZENOH_TF_TREE
name the server; see `connect`. docs/from-tf2.md lists the differences from tf2.
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

from .buffer import Buffer
from .connection import close, connect
from .future import TransformFuture
from .messages import (
    Duration,
    Header,
    Quaternion,
    Time,
    Transform,
    TransformStamped,
    Vector3,
    fill,
)
from .static_transform_broadcaster import StaticTransformBroadcaster
from .transform_broadcaster import TransformBroadcaster
from .transform_listener import TransformListener
from .transforming import (
    TypeException,
    do_transform_point,
    do_transform_pose,
    do_transform_pose_stamped,
    do_transform_pose_with_covariance_stamped,
    do_transform_vector3,
)

__all__ = [
    "BackwardExtrapolationException",
    "Buffer",
    "ConnectivityException",
    "Duration",
    "ExtrapolationException",
    "ForwardExtrapolationException",
    "Header",
    "InvalidArgumentException",
    "LookupException",
    "NoDataForExtrapolationException",
    "Quaternion",
    "StaticTransformBroadcaster",
    "Time",
    "TimeoutException",
    "Transform",
    "TransformBroadcaster",
    "TransformException",
    "TransformFuture",
    "TransformListener",
    "TransformStamped",
    "TypeException",
    "Vector3",
    "close",
    "connect",
    "do_transform_point",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "fill",
]
