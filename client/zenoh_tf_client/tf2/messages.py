"""As `zenoh_tf.tf2.messages`."""

from zenoh_tf.tf2.messages import *  # noqa: F403
