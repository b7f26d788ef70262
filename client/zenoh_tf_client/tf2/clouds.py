from zenoh_tf.tf2.clouds import *  # noqa: F403 - the old name of this module
