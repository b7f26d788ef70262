"""As `zenoh_tf.tf2.message_filter`."""

from zenoh_tf.tf2.message_filter import *  # noqa: F403
