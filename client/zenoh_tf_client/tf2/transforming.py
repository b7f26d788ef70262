"""As `zenoh_tf.tf2.transforming`."""

from zenoh_tf.tf2.transforming import *  # noqa: F403
