"""As `zenoh_tf.tf2.times`."""

from zenoh_tf.tf2.times import *  # noqa: F403
