from zenoh_tf.tf2.transforming import *  # noqa: F403 - the old name of this module
