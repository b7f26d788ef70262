from zenoh_tf import tf2
from zenoh_tf.tf2 import BufferInterface, NotImplementedException

from .connection import SERVER

__all__ = ["Buffer", "BufferInterface", "NotImplementedException"]


class Buffer(tf2.Buffer):
    """As `zenoh_tf.tf2.Buffer` after `connect`, which its first use calls if need be."""

    _server = SERVER
