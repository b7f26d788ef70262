"""As `zenoh_tf.tf2.transform_listener`."""

from zenoh_tf.tf2.transform_listener import *  # noqa: F403
