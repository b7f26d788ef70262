"""As `zenoh_tf.tf2.future`."""

from zenoh_tf.tf2.future import *  # noqa: F403
