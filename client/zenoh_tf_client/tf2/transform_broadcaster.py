from zenoh_tf import tf2

from .connection import SERVER


class TransformBroadcaster(tf2.TransformBroadcaster):
    """As `zenoh_tf.tf2.TransformBroadcaster` after `connect`, which it calls if need be."""

    _server = SERVER
