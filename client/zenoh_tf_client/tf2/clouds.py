"""As `zenoh_tf.tf2.clouds`."""

from zenoh_tf.tf2.clouds import *  # noqa: F403
