"""As `zenoh_tf.tf2.buffer_client`."""

from zenoh_tf.tf2.buffer_client import *  # noqa: F403
