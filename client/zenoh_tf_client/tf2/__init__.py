"""`zenoh_tf.tf2` on the server's tree from the first line on, without a call of `connect`.

The environment variables ZENOH_TF_CONNECT and ZENOH_TF_TREE name the server.
"""

from zenoh_tf.tf2 import *  # noqa: F403 - the same names
from zenoh_tf.tf2 import __all__ as __all__

from .buffer import Buffer as Buffer
from .static_transform_broadcaster import StaticTransformBroadcaster as StaticTransformBroadcaster
from .transform_broadcaster import TransformBroadcaster as TransformBroadcaster
