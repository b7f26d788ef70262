from zenoh_tf import tf2

from .connection import SERVER


class StaticTransformBroadcaster(tf2.StaticTransformBroadcaster):
    """As `zenoh_tf.tf2.StaticTransformBroadcaster` after `connect`, which it calls if need be."""

    _server = SERVER
